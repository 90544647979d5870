"""Projection through calibrated lenses against OpenCV and COLMAP."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.optics import lens as optics
from imaging.optics.lens import Lens
from imaging.optics.pose import as_held, picture_as_held

SIZE = {"width": 640, "height": 480, "fx": 300.0, "fy": 310.0, "cx": 322.0, "cy": 237.0}
LENSES = [
    Lens(model="PINHOLE", **SIZE),
    Lens(model="OPENCV", k1=-0.1, k2=0.02, p1=1e-3, p2=-2e-3, **SIZE),
    Lens(model="OPENCV_FISHEYE", k1=0.05, k2=-0.02, k3=0.004, k4=-0.001, **SIZE),
]
RNG = np.random.default_rng(0)
PIXELS = RNG.uniform(0, (640, 480), (200, 2))


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_projection_is_that_of_colmap_and_its_inverse_undoes_it(lens: Lens) -> None:
    rays = optics.rays(lens, PIXELS)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(optics.project(lens, rays * 3.0), PIXELS, atol=1e-6)
    model = "OPENCV" if lens.model == "PINHOLE" else lens.model
    camera = pycolmap.Camera(model=model, width=640, height=480, params=list(lens.terms))
    np.testing.assert_allclose(camera.img_from_cam(rays), PIXELS, atol=1e-6)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_lens_sees_the_upright_picture_as_it_was_held(lens: Lens, orientation: int) -> None:
    """Points fall on the pixels of the stored picture that light them, wherever these are turned to."""
    stored = np.zeros((480, 640), np.float32)
    columns, rows = np.floor(PIXELS).astype(int).T
    stored[rows, columns] = np.arange(1, len(PIXELS) + 1)
    held, upright = lens.as_held(orientation), picture_as_held(stored, orientation)
    assert upright.shape == (held.height, held.width)
    points = (
        optics.rays(lens, np.stack([columns, rows], axis=1) + 0.5) @ as_held(np.eye(4), orientation)[:3, :3].T
    )
    pixels = optics.project(held, points)
    assert np.abs(pixels - np.floor(pixels) - 0.5).max() < 1e-6
    columns_held, rows_held = np.floor(pixels).astype(int).T
    np.testing.assert_array_equal(upright[rows_held, columns_held], stored[rows, columns])


def test_a_fisheye_is_that_of_opencv() -> None:
    lens = LENSES[2]
    angles = RNG.uniform(0, 1.4, 100)
    turns = RNG.uniform(0, 6, 100)
    points = np.stack([np.sin(angles) * np.cos(turns), np.sin(angles) * np.sin(turns), np.cos(angles)], 1)
    points[0] = 0, 0, 1
    matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    expected, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(lens.terms[4:])
    )
    np.testing.assert_allclose(optics.project(lens, points), expected[:, 0], atol=1e-8)


def test_a_fisheye_that_folds_says_where() -> None:
    terms = (-0.2, 0.01, 0.0, 0.0)
    fold = optics.fisheye_fold(terms)
    angles = np.array([fold - 1e-3, fold, fold + 1e-3])
    inside, top, outside = optics.fisheye_radius(angles, terms)
    assert inside < top > outside
    assert optics.fisheye_fold((0.0, 0.0, 0.0, 0.0)) == math.inf
    beyond = optics.undistort(np.array([[top + 0.1, 0.0]]), terms, fisheye=True)
    assert beyond[0, 0] == pytest.approx(math.tan(min(fold, optics.WIDEST)), rel=1e-6)


def test_the_widest_angle_is_that_of_the_farthest_corner() -> None:
    ideal = Lens(model="OPENCV_FISHEYE", width=640, height=480, fx=400, fy=400, cx=320, cy=240)
    assert optics.widest_angle(ideal) == pytest.approx(1.0, abs=1e-6)  # 400 px in 400 px a radian
    assert optics.widest_angle(ideal.model_copy(update={"k1": -0.4})) == math.inf


def slope(at: Array, terms: tuple[float, ...]) -> Array:
    """The least factor by which a lens stretches anything at tangents [n, 2], by finite differences."""
    step = 1e-5
    columns = [
        optics.distort(at + shift, terms, fisheye=False) - optics.distort(at - shift, terms, fisheye=False)
        for shift in (np.array([step, 0.0]), np.array([0.0, step]))
    ]
    jacobian = np.stack(columns, axis=-1) / (2 * step)
    area = np.linalg.det(jacobian)
    return np.where(area > 0, np.linalg.svd(jacobian, compute_uv=False)[:, -1], -1.0)


@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
@given(st.tuples(*[st.floats(-0.6, 0.6)] * 2, *[st.floats(-0.03, 0.03)] * 2), st.floats(0.05, 2.0))
def test_undistortion_is_exact_wherever_a_lens_does_not_fold(terms: tuple[float, ...], widest: float) -> None:
    reach = min(widest, 0.98 * optics.fold(terms, fisheye=False))
    angles = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    edge = reach * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    within = np.concatenate([edge * share for share in np.linspace(0.1, 1.0, 10)])
    assume((slope(within, terms) > 0.02).all())
    bent = optics.distort(within, terms, fisheye=False)
    np.testing.assert_allclose(optics.undistort(bent, terms, fisheye=False), within, atol=1e-9)


def test_undistortion_far_from_the_axis_of_strong_lenses() -> None:
    """Undo OpenCV's own distortion of pincushions and barrels whose slope is 0.1 to 6."""
    for terms, reach in (
        ((0.4, 0.0, 0.0, 0.0), 0.9),
        ((0.35, 0.2, 0.0, 0.0), 0.8),
        ((0.3, 20.0, 0.0, 0.0), 0.3),
        ((-0.3, 0.0, 0.0, 0.0), 1.0),
        ((-0.25, 0.06, 0.01, -0.02), 1.0),
    ):
        radii = np.linspace(0.01, reach, 50)
        tangents = np.stack([radii * 0.8, radii * 0.6], axis=1)
        rays = np.column_stack([tangents, np.ones(50)])
        bent, _ = cv2.projectPoints(rays[:, None], np.zeros(3), np.zeros(3), np.eye(3), np.array(terms))
        undistorted = optics.undistort(bent.reshape(-1, 2), terms, fisheye=False)
        np.testing.assert_allclose(undistorted, tangents, atol=1e-9)


def test_pixels_beyond_the_fold_of_a_lens_are_told() -> None:
    """k1 = -0.5 folds at a tangent of 0.816, which ends 0.544 from the middle."""
    lens = Lens(model="OPENCV", **SIZE).model_copy(update={"k1": -0.5, "p1": 1e-4})
    end = lens.fx * math.sqrt(2 / 3) * (1 - 0.5 * 2 / 3)
    pixels = np.array([[lens.cx + end * share, lens.cy] for share in (0.5, 0.99, 1.01, 3.0)])
    assert optics.covers(lens, pixels).tolist() == [True, True, False, False]
    assert np.isfinite(optics.rays(lens, pixels)).all()
    assert optics.fold(lens.terms[4:], fisheye=False) == pytest.approx(math.sqrt(2 / 3), rel=1e-12)
    assert optics.fold((0.1, 0.0, 0.0, 0.0), fisheye=False) == math.inf
    assert optics.fold((-1e-300, 1e-300, 0.0, 0.0), fisheye=False) > 1e100
