"""Neighbour's picture of a plane, against the projection and OpenCV's interpolation."""

import cv2
import numpy as np
import pytest

from recon.data.geometry import inside, project_camera, rays
from recon.splat import SplatCamera
from recon.start.warped_plane import PATCH, SOFT, compare_planes, warp

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


@pytest.mark.parametrize("terms", [{}, BROWN], ids=["pinhole", "brown"])
@pytest.mark.parametrize("two", [True, False])
def test_scores_are_the_correlation_of_patches_in_float64(terms, two):
    """Two pictures of two neighbours, each on three planes; a part of the first is a bare wall."""
    lens = SplatCamera(np.eye(4), 30.0, 31.0, 20.0, 15.0, 40, 30, **terms)
    rng = np.random.default_rng(2)
    image, *pictures = (rng.normal(-15, 1, (30, 40)).astype(np.float32) for _ in range(3))
    pictures[0][:, :20] = -19.999
    x, y = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    directions, planes = rays(lens, np.stack([x, y], -1)), np.array([0.0, 0.5, 1.0])
    shift = np.array([0.1, -0.05, 0.02])
    first = np.full((3, 30, 40), -1.0, np.float32)
    second = first.copy() if two else first

    def mean(values):
        return cv2.blur(values, (PATCH, PATCH))

    scores, light = [], image.astype(np.float64)
    for picture in pictures:
        compare_planes(lens, picture, directions, shift, planes, image, first, second)
        warped, shown = np.empty((30, 40), np.float32), np.empty((30, 40), bool)
        for plane in planes:
            warp(lens, picture, directions, plane * shift, warped, shown)
            there = warped.astype(np.float64)
            both = mean(light * there) - mean(light) * mean(there)
            varied = [(mean(one * one) - mean(one) ** 2).clip(0) for one in (light, there)]
            alike = (both + SOFT) / np.sqrt((varied[0] + SOFT) * (varied[1] + SOFT))
            scores.append(np.where(shown, alike, -1))
    low, high = np.sort(np.reshape(scores, (2, 3, 30, 40)), axis=0)
    np.testing.assert_allclose(first, high, atol=1e-4)
    assert first.max() <= 1 + 1e-6
    if two:
        np.testing.assert_allclose(second, low, atol=1e-4)


def test_texture_before_a_flat_patch_is_as_unlike_as_other_texture():
    """A background of one value, as of renders, matches everything if it matches texture."""
    lens = SplatCamera(np.eye(4), 30.0, 30.0, 20.0, 15.0, 40, 30)
    image = np.random.default_rng(0).normal(0, 0.3, (30, 40)).astype(np.float32)
    x, y = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    directions = rays(lens, np.stack([x, y], -1))
    for flat, score in ((image, 0.04), (np.zeros_like(image), 1.0)):
        scores = np.full((1, 30, 40), -1.0, np.float32)
        neighbour = np.full((30, 40), 0.0, np.float32)
        compare_planes(lens, neighbour, directions, np.zeros(3), np.zeros(1), flat, scores, scores)
        assert np.median(scores) == pytest.approx(score, abs=0.03)
