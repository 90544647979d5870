"""Projection through calibrated lenses against OpenCV and COLMAP."""

import math

import cv2
import numpy as np
import pytest

from imaging import lens as optics
from imaging.calibration import Lens
from imaging.colmap import pycolmap

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
