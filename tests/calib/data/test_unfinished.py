"""Results of a stopped calibration are computed once, and never taken for the answer to another question."""

from pathlib import Path

import numpy as np
import pytest

from calib.data import unfinished
from calib.data.unfinished import FOLDER, Unfinished

VALUE = np.arange(6, dtype=np.uint8).reshape(2, 3)


def begun(session: Path, question: object = "q") -> Unfinished:
    unfinished = Unfinished(session, question)
    unfinished.keep_large("0003/left", {"points": VALUE, "name": np.array("black")})
    unfinished.keep("a b", VALUE)
    unfinished.flush()
    return unfinished


def test_what_was_found_is_there_again(tmp_path):
    begun(tmp_path)
    again = Unfinished(tmp_path, "q")
    arrays = again.large("0003/left")
    assert arrays["points"].dtype == VALUE.dtype
    assert (arrays["points"] == VALUE).all()
    assert str(arrays["name"]) == "black"
    assert np.array_equal(again.small("a b"), VALUE)
    again.keep("a c", VALUE + 1)
    again.flush()
    assert np.array_equal(Unfinished(tmp_path, "q").small("a c"), VALUE + 1)
    again.finish()
    assert not (tmp_path / FOLDER).exists()


def test_another_question_finds_nothing(tmp_path):
    begun(tmp_path)
    other = Unfinished(tmp_path, "another")
    assert other.small("a b") is None
    assert other.large("0003/left") is None


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 no more", None])
def test_damaged_files_count_for_nothing(tmp_path, damage):
    begun(tmp_path)
    for file in (tmp_path / FOLDER).glob("*.npz"):
        file.write_bytes(file.read_bytes()[:-40] if damage is None else damage)
    again = Unfinished(tmp_path, "q")
    assert again.small("a b") is None
    assert again.large("0003/left") is None


def test_a_damaged_question_is_another_one(tmp_path):
    begun(tmp_path)
    (tmp_path / FOLDER / "question").write_bytes(b"\xff\xfe")
    assert Unfinished(tmp_path, "q").small("a b") is None


def test_killed_it_loses_the_last_seconds_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(unfinished, "EVERY", -1.0)
    Unfinished(tmp_path, "q").keep("a b", VALUE)
    assert np.array_equal(Unfinished(tmp_path, "q").small("a b"), VALUE)


def test_without_a_session_matches_are_kept_in_memory():
    unfinished = Unfinished()
    unfinished.keep("a b", VALUE)
    unfinished.flush()
    assert np.array_equal(unfinished.small("a b"), VALUE)
    unfinished.finish()
