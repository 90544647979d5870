"""A path-traced crate whose four sides look alike, lit from one side: no view stands before the wrong one."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from calib.calibrate import calibrate
from imaging.errors import PartialError
from imaging.session.calibration import read_calibration

from . import truth
from .photographs import session
from .scenes import Scene, box, floor, plain, ring, spots, surface, windows

pytest.importorskip("mitsuba")


def test_no_view_of_a_crate_with_like_sides_is_placed_wrongly(tmp_path: Path) -> None:
    """Either the views are placed rightly, or it is said that parts of the scene look alike."""
    side, ground = surface(spots(1)), surface(plain(0.4))
    shapes = box("box", [side] * 4, surface(spots(5)), np.eye(4)) | floor(ground)
    scene = Scene("small-crate", shapes, windows(), ring(14), width=200, height=150, samples=8)
    made = session(tmp_path / "S", scene.light())
    with suppress(PartialError):
        calibrate(made)
    record = read_calibration(made)
    estimated = {view.frame: view.cam_from_world.matrix() for view in record.views}
    assert truth.errors(estimated, scene.poses).wrong == []
    assert len(record.views) + len(record.unregistered) == len(scene.poses)
