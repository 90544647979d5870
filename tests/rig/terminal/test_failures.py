"""Every failure becomes one sentence and the right exit code."""

import errno
import json
import os
import signal
from pathlib import Path

import pytest

from imaging import errors
from imaging.files import store
from rig.terminal.failures import explained


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.InputError("S is missing: make it."), 2),
        (errors.StorageError("S could not be written (no space left on device): free the disk."), 2),
        (errors.CaptureError("no"), 2),
        (errors.CalibrationError("no"), 2),
        (errors.ReconstructionError("no"), 2),
        (errors.CameraError("no"), 2),
        (errors.PartialError("2 of 3 are there."), 3),
    ],
)
def test_errors_of_rig_keep_their_words_and_codes(error: errors.RigError, code: int) -> None:
    line, given = explained(error)
    assert given == code
    assert line.rstrip(".") == str(error).rstrip(".")
    assert line.endswith(".")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.ENAMETOOLONG])
def test_a_refusal_of_the_disk_that_no_stage_translated_names_the_file(number: int) -> None:
    line, code = explained(OSError(number, os.strerror(number), "/media/disk/x"))
    assert code == 2
    assert line.startswith("/media/disk/x ")
    assert os.strerror(number).lower() in line


def test_a_full_disk_without_a_name_is_still_told() -> None:
    assert explained(OSError(errno.ENOSPC, "No space left on device"))[1] == 2


def test_no_memory_is_told_with_the_mend() -> None:
    for error in (MemoryError(), RuntimeError("DefaultCPUAllocator: can't allocate memory: tried 9 bytes")):
        line, code = explained(error)
        assert code == 2
        assert "memory" in line
        assert "--quality draft" in line


def test_anything_else_is_a_defect_with_the_traceback_in_a_file(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    try:
        raise KeyError("secret\nof ours")
    except KeyError as error:
        line, code = explained(error)
    (file,) = tmp_path.iterdir()
    assert code == 1
    assert "defect of rig" in line
    assert str(file) in line
    assert "Traceback" not in line
    assert "\n" not in line
    assert "test_anything_else_is_a_defect" in file.read_text()


def test_a_defect_where_nothing_can_be_written_says_how_to_see_it(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    (tmp_path / "file").write_text("not a folder")
    line, code = explained(ZeroDivisionError())
    assert code == 1
    assert "RIG_DEBUG=1" in line


def test_a_defect_in_a_command_shows_no_traceback(rig, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("capture.check.check.check", lambda session, on_progress: [][1])
    code, out, err = rig("check", str(tmp_path))
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert "defect" in err
    assert "IndexError in check: " in err
    (file,) = tmp_path.glob("rig-defect-*.txt")
    report = file.read_text()
    assert report.startswith(f"command: rig check {tmp_path}\nfolder: {os.getcwd()}\ndoing: check: ")
    assert "Python 3." in report
    assert "IndexError: list index out of range" in report


def test_rig_debug_lets_the_traceback_through(rig, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RIG_DEBUG", "1")
    monkeypatch.setattr("capture.check.check.check", lambda session, on_progress: [][1])
    with pytest.raises(IndexError):
        rig("check", str(tmp_path))


def test_ctrl_c_in_a_capture_leaves_what_resume_completes(rig, monkeypatch, tmp_path: Path) -> None:
    """A true SIGINT, sent when the fifth shot is on the disk."""
    append, lines = store.append_line, []

    def append_and_interrupt(path: Path, value: object) -> None:
        append(path, value)
        lines.append(value)
        if len(lines) == 1 + 5:  # the plan, and five shots
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(store, "append_line", append_and_interrupt)
    capture = ["capture", "--sim", "toy", str(tmp_path / "S"), "--json"]
    code, out, err = rig(*capture)
    assert code == json.loads(out)["exit_code"] == 130
    assert "--resume" in err
    code, out, err = rig(*capture, "--resume")
    assert (code, err) == (0, "")
    assert json.loads(out)["earlier"] == 5
    assert json.loads(out)["taken"] == json.loads(out)["planned"] - 5


def test_ctrl_c_says_how_to_go_on(rig, monkeypatch, tmp_path: Path) -> None:
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("capture.check.check.check", interrupted)
    monkeypatch.setattr("capture.record.shooting.shoot", interrupted)
    code, out, err = rig("check", str(tmp_path))
    assert (code, out) == (130, "")
    assert err == "stopped; run the same command again to continue.\n"
    code, out, err = rig("capture", "--sim", "toy", str(tmp_path / "S"))
    assert code == 130
    assert "--resume" in err
    assert not (tmp_path / "S").exists()
