"""Neighbour's picture of a plane, against the projection and OpenCV's interpolation."""

import cv2
import numpy as np
import pytest

from recon.data.geometry import inside, project_camera, rays
from recon.splat import SplatCamera
from recon.start.warped_plane import warp

BROWN = {"k1": -0.08, "k2": 0.02, "p1": 2e-3, "p2": -1e-3}
FISHEYE = {"k1": -0.05, "k2": 0.01, "k3": -2e-3, "k4": 5e-4, "fisheye": True}


@pytest.mark.parametrize(
    "terms", [{}, BROWN, {"k1": -0.4}, FISHEYE], ids=["pinhole", "brown", "folds", "fisheye"]
)
@pytest.mark.parametrize("shift", [(0.1, 0.02, -0.3), (0.0, 0.0, 0.0), (3.0, -2.0, -0.7)])
def test_a_plane_is_seen_where_the_lens_puts_it(terms, shift):
    lens = SplatCamera(np.eye(4), 300.0, 310.0, 205.0, 148.0, 400, 300, **terms)
    picture = np.random.default_rng(1).normal(size=(120, 160)).astype(np.float32)
    x, y = np.meshgrid(np.arange(32) * 12.5 + 6, np.arange(24) * 12.5 + 6)
    points = rays(lens, np.stack([x, y], -1)) @ np.diag([1.2, 1.2, 1.0])
    points[0, 0, 2] = -5.0
    out, shown = np.empty(x.shape, np.float32), np.empty(x.shape, bool)
    warp(lens, picture, points, np.array(shift), out, shown)

    pixels, depth = project_camera(lens, points + np.array(shift))
    np.testing.assert_array_equal(shown, inside(lens, pixels, depth))
    at = (pixels * (160 / 400, 120 / 300) - 0.5).clip(-1e4, 1e4).astype(np.float32)
    expected = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    before = depth > 0
    # OpenCV rounds places to 1/32 px where it has no finer way.
    np.testing.assert_allclose(out[before], expected[before], atol=0.1)
    assert np.abs(out - expected)[before].mean() < 0.02
    assert not shown[~before].any()
    assert (out[~before] == 0).all()
