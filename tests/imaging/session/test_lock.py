"""What is made in a session has one maker at a time, however the one before ended."""

import errno
import os
import shutil
from pathlib import Path

import pytest

from imaging.errors import InputError, StorageError
from imaging.session import lock
from imaging.session.lock import sole_calibrator, sole_maker

fcntl = pytest.importorskip("fcntl", reason="locks of POSIX")


def test_one_makes_it_and_no_file_is_left(tmp_path: Path) -> None:
    shelf = tmp_path / "reconstructions"
    shelf.mkdir()
    (shelf / ".a.lock").touch()  # as a killed process leaves it
    with sole_maker(shelf / "a"):
        says = rf"{tmp_path}/reconstructions/a is being made by another rig: wait for it"
        with pytest.raises(InputError, match=says), sole_maker(shelf / "a"):
            pass
        with sole_maker(shelf / "b"):
            pass
    assert not list(shelf.iterdir())
    with sole_maker(shelf / "a"):
        pass


def test_a_folder_without_write_permission_is_refused_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = os.open

    def refusing(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & os.O_CREAT and str(path).endswith(".lock"):
            raise PermissionError(errno.EACCES, "permission denied")
        return opened(path, flags, mode)

    monkeypatch.setattr(os, "open", refusing)
    with pytest.raises(StorageError, match="permission denied"), sole_maker(tmp_path / "a"):
        pass


@pytest.mark.parametrize("writable", [True, False])
def test_a_calibration_has_one_maker_where_the_session_is_read_only_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writable: bool
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: writable)
    with sole_maker(tmp_path / "reconstructions/a"), sole_calibrator(tmp_path):
        files = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
        place = "" if writable else "calibration/"
        assert files == {"reconstructions/.a.lock", f"{place}.calibration.lock"}
        says = rf"{tmp_path}/calibration is being made by another rig: wait for it"
        with pytest.raises(InputError, match=says), sole_calibrator(tmp_path):
            pass
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    with sole_calibrator(tmp_path):
        pass


def test_a_calibration_is_held_where_files_have_to_be_open_for_writing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_nfs(monkeypatch)
    (tmp_path / "session.json").touch()
    with sole_calibrator(tmp_path), pytest.raises(InputError), sole_calibrator(tmp_path):
        pass


def on_nfs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse exclusive locks of descriptors that only read, as NFS does."""
    flock = fcntl.flock

    def refusing(descriptor: int, operation: int) -> None:
        reads = fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY
        if reads and operation & fcntl.LOCK_EX:
            raise OSError(errno.EBADF, "bad file descriptor")
        flock(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", refusing)


def test_of_two_users_on_nfs_one_makes_a_calibration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second may only read the lock file of the first."""
    on_nfs(monkeypatch)
    opened = os.open

    def reading(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & os.O_RDWR and str(path).endswith(".lock"):
            raise PermissionError(errno.EACCES, "permission denied")
        return opened(path, flags, mode)

    with sole_calibrator(tmp_path):
        monkeypatch.setattr(os, "open", reading)
        with pytest.raises(InputError, match="by another rig"), sole_calibrator(tmp_path):
            pass
        monkeypatch.setattr(os, "open", opened)
    (tmp_path / ".calibration.lock").touch()  # as a killed process of the first leaves it
    monkeypatch.setattr(os, "open", reading)
    with sole_calibrator(tmp_path):
        pass


def test_a_lock_file_of_another_user_holds_nothing_once_its_process_is_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / ".calibration.lock").touch()
    opened = os.open

    def refusing(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & os.O_RDWR and str(path).endswith(".lock"):
            raise PermissionError(errno.EACCES, "permission denied")
        return opened(path, flags, mode)

    monkeypatch.setattr(os, "open", refusing)
    with (
        sole_calibrator(tmp_path),
        pytest.raises(InputError, match="by another rig"),
        sole_calibrator(tmp_path),
    ):
        pass


def test_copies_of_a_session_that_share_its_files_are_calibrated_at_once(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one/session.json").touch()
    shutil.copytree(tmp_path / "one", tmp_path / "two", copy_function=os.link)
    with sole_calibrator(tmp_path / "one"), sole_calibrator(tmp_path / "two"):
        locks = [tmp_path / name / ".calibration.lock" for name in ("one", "two")]
        assert not os.path.samefile(*locks)
    assert not any(lock.exists() for lock in locks)


def test_a_lock_that_went_as_it_was_opened_holds_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its holder removes the file between the opening and the lock of the next."""
    locked, opened = lock._locked, []

    def late(path: Path, flags: int, says: str) -> int | None:
        opened.append(path)
        descriptor = locked(path, flags, says)
        if len(opened) == 1:
            path.unlink()
        return descriptor

    monkeypatch.setattr(lock, "_locked", late)
    with sole_maker(tmp_path / "a"):
        assert len(opened) == 2
        with pytest.raises(InputError), sole_maker(tmp_path / "a"):
            pass
