"""What is made in a session has one maker at a time, however the one before ended."""

from pathlib import Path

import pytest

from imaging.errors import InputError
from imaging.session import lock
from imaging.session.lock import sole_calibrator, sole_maker

pytest.importorskip("fcntl", reason="locks of POSIX")


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


def test_nothing_is_written_into_the_session_which_may_be_read_only(tmp_path: Path) -> None:
    (tmp_path / "session.json").touch()
    with sole_maker(tmp_path / "reconstructions/a"), sole_calibrator(tmp_path):
        names = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
        assert names == {"session.json", "reconstructions", "reconstructions/.a.lock"}
        says = rf"{tmp_path}/calibration is being made by another rig: wait for it"
        with pytest.raises(InputError, match=says), sole_calibrator(tmp_path):
            pass
    with sole_calibrator(tmp_path):
        pass


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
