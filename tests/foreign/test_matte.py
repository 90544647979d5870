"""True albedo of pixels, by light over irradiance, is that of the textures."""

import cv2
import numpy as np
import pytest

from .lit import LitScene, Panel
from .matte import matte
from .scenes import look_at, moved, spots

pytest.importorskip("mitsuba")


def test_albedo_is_that_of_the_texture() -> None:
    """Under a sky that is brighter on one side."""
    floor = Panel(moved(0, 0, 0, size=(1, 2, 1)), cv2.blur(spots(3, 128), (13, 13)), (12, 24))
    sky = np.ones((16, 32, 3), np.float32)
    sky[:, :8] = 4
    pose = look_at([0.3, -0.4, 2.5], [0, 0, 0])
    scene = LitScene("floor", {"floor": floor}, {}, pose[None], sky, 50.0, 64, 48, 16, 64)
    truth = matte(scene)
    x, y = np.meshgrid(np.arange(64) + 0.5 - 32, np.arange(48) + 0.5 - 24)
    rays = np.stack([x, y, np.full(x.shape, scene.focal)], -1) @ pose[:3, :3]
    centre = np.linalg.inv(pose)[:3, 3]
    places = centre[:2] - rays[..., :2] * (centre[2] / rays[..., 2])[..., None]
    column = ((places[..., 0] + 1) / 2 * 128).astype(int)
    row = ((places[..., 1] / 2 + 1) / 2 * 128).astype(int)
    known = np.isfinite(truth.albedo[0, ..., 0])
    assert known.mean() > 0.4
    texture = floor.reflectance[row.clip(0, 127), column.clip(0, 127)]
    off = np.abs(truth.albedo[0] - texture)[known]
    assert np.median(off) < 0.03
    assert np.median(np.abs(truth.albedo[0] - texture[::-1])[known]) > 0.06
    assert 1 < np.nanmedian(truth.irradiance) / np.pi < 4
