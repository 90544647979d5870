"""Lens terms by frames of a board that are held out, whose corners count alike."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.boards import ladder
from imaging.progress import unreported
from imaging.session.view_id import ViewId


@pytest.mark.parametrize(("last", "taken"), [(2, True), (100, False)])
def test_a_frame_of_few_corners_decides_nothing(monkeypatch, last, taken):
    """Eleven frames fit better by a radial term, the last, of so many corners, much worse."""
    counts = np.array([100.0] * 11 + [last])
    per_corner = {
        "PINHOLE": np.array([1.0] * 11 + [1.0]),
        "SIMPLE_RADIAL": np.array([0.8] * 11 + [9.0]),
    }

    def held_out(board, corners, solved, free, frames):
        return per_corner.get(free.model, np.full(12, 2.0)) * counts, counts

    monkeypatch.setattr(ladder, "_held_out", held_out)
    corners = {ViewId(frame, "cam"): None for frame in range(12)}
    free, rungs = ladder.climb(None, corners, SimpleNamespace(lenses={}), unreported)
    assert [rung.taken for rung in rungs] == [taken, False, False]
    assert free.model == ("SIMPLE_RADIAL" if taken else "PINHOLE")
