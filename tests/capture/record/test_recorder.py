import errno
import hashlib
import re
from contextlib import suppress

import pytest

from capture.bracket.acceptance import RETRIES
from capture.record import recorder
from capture.record.capture_run import CaptureRun
from capture.record.recorder import record
from capture.record.threads.camera_worker import GIVE_UP_AFTER
from drivers.errors import CameraGone
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import CameraError, CaptureError, InputError, PartialError, StorageError
from imaging.files import store
from imaging.files.raw import read_raw


def run(rig, **options):
    options = {"clock": VirtualClock()} | options
    return record(rig.session, rig.plan, rig.cameras, move_to=rig.move_to, **options)


def raw_files(session) -> dict[str, bytes]:
    root = session.folder / "raw"
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()}


def test_every_shot_is_there_with_hash_exposures_size_and_skew(fake_rig):
    rig = fake_rig()
    finished = []
    result = run(rig, progress=lambda message, done, total: finished.append((message, done, total)))
    assert (result.planned, result.taken, result.earlier) == (18, 18, 0)
    assert (result.missing, result.problems) == ((), ())
    result.require_complete()
    shots = rig.session.shots()
    assert [(s.camera, s.frame, s.step) for s in shots] == [
        (camera, frame, step) for frame in range(3) for step in range(3) for camera in "ab"
    ]
    for shot in shots:
        path = rig.session.file(shot)
        assert hashlib.sha256(path.read_bytes()).hexdigest() == shot.sha256
        assert shot.requested == rig.plan.bracket[shot.step] == shot.reported
        assert (shot.width, shot.height, shot.retries) == (32, 24, 0)
        assert shot.skew == pytest.approx(0.0 if shot.camera == "a" else 0.004)
        assert shot.captured_at.second == shot.frame
    assert shots[0].file == "raw/0000/a_0.dng"
    assert shots[1].file == "raw/0000/b_0.jpg"
    assert finished[0] == ("shooting", 0, 18)
    assert finished[1:] == [(shot.file, n, 18) for n, shot in enumerate(shots, start=1)]


def test_the_file_holds_the_frame_that_the_camera_gave(fake_rig):
    rig = fake_rig(a="raw")
    run(rig, compression="ljpeg")
    camera = rig.cameras["a"]
    camera.frame, camera.setting = 1, rig.plan.bracket[2]
    expected = camera.collect()
    mosaic = read_raw(rig.session.folder / "raw/0001/a_2.dng")
    assert (mosaic.pixels == expected.pixels).all()
    assert mosaic.metadata.exposure.time == pytest.approx(1 / 128)


def test_all_are_set_and_armed_before_the_first_is_triggered(fake_rig):
    rig = fake_rig(a="raw", b="raw", c="raw")
    run(rig)
    places: dict[str, list[int]] = {"arm": [], "trigger": []}
    for place, (operation, _) in enumerate(rig.log):
        places.get(operation, []).append(place)
    for step in range(9):
        together = slice(3 * step, 3 * step + 3)
        assert max(places["arm"][together]) < min(places["trigger"][together])
    for camera in rig.cameras.values():
        assert camera.calls == ["set_exposure", "arm", "trigger", "collect"] * 9


def test_a_finished_capture_is_not_touched_again(fake_rig):
    rig = fake_rig()
    run(rig)
    before, index = raw_files(rig.session), (rig.session.folder / "shots.jsonl").read_bytes()
    rig.log.clear()
    result = run(rig)
    assert (result.taken, result.earlier) == (0, 18)
    assert rig.log == []
    assert raw_files(rig.session) == before
    assert (rig.session.folder / "shots.jsonl").read_bytes() == index


@pytest.mark.parametrize("lost", ["record", "file", "torn line", "stale part"])
def test_resume_takes_exactly_what_is_missing_and_ends_with_the_same_bytes(fake_rig, lost):
    whole, rig = fake_rig("whole"), fake_rig("broken")
    run(whole)
    run(rig)
    index = rig.session.folder / "shots.jsonl"
    lines = index.read_bytes().splitlines(keepends=True)
    if lost == "record":  # killed between the file and its line; the file may be of another moment
        index.write_bytes(b"".join(lines[:-1]))
        (rig.session.folder / "raw/0002/b_2.jpg").write_bytes(b"of another moment")
    elif lost == "file":
        (rig.session.folder / "raw/0002/b_2.jpg").unlink()
    elif lost == "torn line":
        index.write_bytes(b"".join(lines)[:-9])
    else:
        index.write_bytes(b"".join(lines[:-1]))
        (rig.session.folder / "raw/0002/b_2.jpg").rename(rig.session.folder / "raw/0002/.b_2.jpg.part")
        (rig.session.folder / ".shots.jsonl.part").write_bytes(b"half")
    rig.log.clear()
    result = run(rig)
    assert (result.taken, result.earlier) == (1, 17)
    assert {serial for _, serial in rig.log} == {"serial-b"}
    assert raw_files(rig.session) == raw_files(whole.session)
    assert not list(rig.session.folder.rglob("*.part"))
    shots = {s.identity: s for s in rig.session.shots()}
    assert len(shots) == 18
    # part of the rig exposed in another run: nobody knows how far apart
    assert shots["scene", "b", 2, 2].skew is None


def test_a_camera_error_is_retried_and_the_late_shutter_is_told(fake_rig):
    rig = fake_rig(a="raw", b="raw")
    rig.cameras["b"].faults["collect", 5] = CameraError("camera serial-b timed out: check its cable.")
    result = run(rig)
    assert result.missing == ()
    shots = {(s.camera, s.frame, s.step): s for s in rig.session.shots()}
    assert [key for key, shot in shots.items() if shot.retries] == [("b", 1, 1)]
    assert shots["b", 1, 1].retries == 1
    assert shots["b", 1, 1].skew == pytest.approx(1.004)  # it was triggered once more, a second later
    assert rig.cameras["a"].calls.count("trigger") == 9  # the others are not made to repeat


@pytest.mark.parametrize("operation", ["set_exposure", "arm", "trigger", "collect"])
def test_a_camera_that_keeps_failing_one_shot_is_listed_and_the_rest_goes_on(fake_rig, operation):
    rig = fake_rig(a="raw", b="raw")
    # What fails while the others expose is tried again at once; the other steps of the frame come between.
    calls = (1, 4, 5) if operation in ("set_exposure", "arm") else (1, 2, 5, 6, 7, 8)
    for call in calls:
        rig.cameras["b"].faults[operation, call] = CameraError(f"camera serial-b refuses {operation}.")
    result = run(rig)
    assert result.taken == 17
    assert result.missing == (f"b, frame 0, step 0: camera serial-b refuses {operation}",)
    with pytest.raises(PartialError, match=r"1 of 18 shots are missing \(b, frame 0, step 0") as caught:
        result.require_complete()
    assert caught.value.exit_code == 3
    assert "--resume" in str(caught.value)
    again = run(rig)
    assert (again.taken, again.missing) == (1, ())


def test_a_camera_that_vanishes_is_given_up_and_the_others_finish(fake_rig):
    rig = fake_rig(a="raw", b="raw")
    attempts = GIVE_UP_AFTER * (RETRIES + 1)
    for call in range(3, 100):
        rig.cameras["b"].faults["set_exposure", call] = CameraError("camera serial-b is gone: plug it in.")
    result = run(rig)
    assert len([s for s in rig.session.shots() if s.camera == "a"]) == 9
    assert len(result.missing) == 7
    assert all(sentence.startswith("b, frame") for sentence in result.missing)
    assert result.missing[0] == "b, frame 0, step 2: camera serial-b is gone: plug it in"
    assert result.missing[-1] == "b, frame 2, step 2: given up after failing before"
    assert rig.log.count(("set_exposure", "serial-b")) == 2 + attempts
    rig.cameras["b"].faults.clear()
    assert run(rig).taken == 7


def test_a_camera_that_was_waited_for_in_vain_costs_few_attempts_and_is_reported(fake_rig):
    rig, said = fake_rig(a="raw", b="raw"), []
    for call in range(3, 100):
        rig.cameras["b"].faults["set_exposure", call] = CameraGone("Camera serial-b does not come back.")
    result = run(rig, progress=lambda message, done, total: said.append(message))
    assert rig.log.count(("set_exposure", "serial-b")) == 2 + GIVE_UP_AFTER
    lost = [message for message in said if "lost" in message]
    assert lost == ["b is lost, the others go on: Camera serial-b does not come back."]
    with pytest.raises(PartialError, match="b, frame 1, step 0 and 5 more: given up after failing before"):
        result.require_complete()
    rig.cameras["b"].faults.clear()
    rig.cameras["b"].faults["set_exposure", rig.cameras["b"].calls.count("set_exposure") + 1] = CameraGone(
        "x."
    )
    said.clear()
    run(rig, progress=lambda message, done, total: said.append(message))
    assert [message for message in said if " is " in message] == [
        "b is lost, the others go on: x.",
        "b is back: raw/0000/b_2.dng",
    ]


def test_a_shot_that_was_not_tried_has_no_invented_reason(fake_rig, monkeypatch):
    rig = fake_rig(a="raw")
    monkeypatch.setattr(CaptureRun, "frames", lambda self: iter((0, 1)))
    assert run(rig).missing[0] == "a, frame 2, step 0: it was not taken"


def test_cameras_that_were_swapped_are_refused_before_the_first_shot(fake_rig):
    rig = fake_rig(a="raw", b="raw")
    rig.cameras = {"a": rig.cameras["b"], "b": rig.cameras["a"]}
    with pytest.raises(
        CaptureError, match="in the place of a has the serial number 'serial-b', not 'serial-a'"
    ):
        run(rig)
    assert rig.session.shots() == []


def test_a_defect_of_ours_is_not_taken_for_a_camera_error(fake_rig):
    rig = fake_rig(a="raw")
    rig.cameras["a"].faults["arm", 2] = ZeroDivisionError()
    with pytest.raises(ZeroDivisionError):
        run(rig)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
@pytest.mark.parametrize("moment", range(1, 8))
def test_a_disk_that_refuses_stops_the_capture_and_keeps_what_is_finished(
    fake_rig, monkeypatch, code, moment
):
    """The n-th write of a file's bytes, or of a line, is refused half-way."""
    whole, rig = fake_rig("whole"), fake_rig("full")
    run(whole)
    writes = 0
    refuse = True
    write_pieces, append = store.write_pieces, store.append_line

    def refused() -> bool:
        nonlocal writes
        writes += 1
        return refuse and writes == moment

    def half(pieces):
        yield next(iter(pieces))
        raise OSError(code, "refused")

    def append_line(path, value):
        if refused():
            with path.open("ab") as file:
                file.write(b'{"kind": "sce')
            raise store.refused(path, OSError(code, "refused"))
        append(path, value)

    monkeypatch.setattr(store, "append_line", append_line)
    monkeypatch.setattr(
        store, "write_pieces", lambda path, data: write_pieces(path, half(data) if refused() else data)
    )
    result = None
    with suppress(StorageError):
        result = run(rig)
    shots = rig.session.shots()
    assert (result is None) == (shots == [])
    for shot in shots:
        assert store.sha256(rig.session.file(shot)) == shot.sha256
    assert not list(rig.session.folder.rglob("*.part"))
    assert rig.log.count(("trigger", "serial-a")) < 9
    if result is not None:
        assert result.taken == len(shots)
        assert len(result.missing) == 18 - len(shots)
        # Each names the file that was refused, which may be that of another camera, and says so.
        reason = re.compile(
            r"\w, frame \d, step \d: the capture stopped: \S+ could not be written \(refused\)$"
        )
        assert all(reason.match(sentence) for sentence in result.missing), result.missing
        mend = "free some space on the disk" if code == errno.ENOSPC else "name a place on a disk that"
        with pytest.raises(
            PartialError, match=rf"\(refused\)\): {mend}.*, then repeat the command with --resu"
        ):
            result.require_complete()
    refuse = False
    assert run(rig).taken == 18 - len(shots)
    assert raw_files(rig.session) == raw_files(whole.session)


def test_a_record_that_leads_out_of_the_session_is_refused(fake_rig):
    rig = fake_rig(a="raw")
    run(rig)
    index = rig.session.folder / "shots.jsonl"
    index.write_text(index.read_text().replace("raw/0000/a_0.dng", "../../etc/passwd"))
    with pytest.raises(InputError, match="leads out of"):
        run(rig)


def test_leftovers_behind_a_link_are_left_alone(fake_rig, tmp_path):
    rig = fake_rig(a="raw")
    run(rig)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / ".x.part").write_bytes(b"not ours")
    (rig.session.folder / "raw" / "0009").symlink_to(elsewhere)
    assert recorder.leftovers(rig.session) == []
    run(rig)
    assert (elsewhere / ".x.part").exists()
