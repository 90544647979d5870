"""What is made in a session has one maker at a time, however the one before ended."""

from pathlib import Path

import pytest

from imaging.errors import InputError
from imaging.session import lock
from imaging.session.lock import sole_maker

pytest.importorskip("fcntl", reason="locks of POSIX")


def test_one_makes_it_and_no_file_is_left(tmp_path: Path) -> None:
    (tmp_path / ".reconstructions.a.lock").touch()  # as a killed process leaves it
    with sole_maker(tmp_path, "reconstructions/a"):
        says = rf"{tmp_path}/reconstructions/a is being made by another rig: wait for it"
        with pytest.raises(InputError, match=says), sole_maker(tmp_path, "reconstructions/a"):
            pass
        with sole_maker(tmp_path, "reconstructions/b"), sole_maker(tmp_path, "calibration"):
            pass
    assert not list(tmp_path.iterdir())
    with sole_maker(tmp_path, "reconstructions/a"):
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
    with sole_maker(tmp_path, "calibration"):
        assert len(opened) == 2
        with pytest.raises(InputError), sole_maker(tmp_path, "calibration"):
            pass
