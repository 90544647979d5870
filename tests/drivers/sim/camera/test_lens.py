"""Projection and its inverse against OpenCV, and against each other."""

import cv2
import numpy as np
import pytest

from drivers.sim.camera.lens import parameters, project, unproject
from imaging.optics.lens import Lens

LENSES = [
    Lens(model="PINHOLE", width=320, height=240, fx=320, fy=320, cx=160, cy=120),
    Lens(model="SIMPLE_RADIAL", width=320, height=240, fx=300, fy=300, cx=161, cy=118, k1=-0.08),
    Lens(
        model="OPENCV",
        width=320,
        height=240,
        fx=310,
        fy=313,
        cx=158.5,
        cy=121.2,
        k1=-0.07,
        k2=0.01,
        p1=1e-3,
        p2=-2e-3,
    ),
    Lens(
        model="OPENCV_FISHEYE",
        width=320,
        height=240,
        fx=150,
        fy=152,
        cx=158.5,
        cy=121.2,
        k1=0.04,
        k2=-0.02,
        k3=0.005,
        k4=-0.001,
    ),
    Lens(model="RADIAL_FISHEYE", width=320, height=240, fx=150, fy=150, cx=160, cy=120, k1=0.04, k2=-0.02),
]


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_project_agrees_with_opencv(lens: Lens) -> None:
    points = np.random.default_rng(0).uniform((-1.2, -0.9, 2.0), (1.2, 0.9, 6.0), (500, 3))
    # OpenCV puts the centre of the first pixel at 0, this project at 0.5.
    matrix = np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1]])
    if lens.fisheye:
        points = points * (4, 4, 1)
        terms = parameters(lens)[4:8]
        expected, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, terms)
    else:
        expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, parameters(lens)[4:8])
    np.testing.assert_allclose(project(lens, points) - 0.5, expected.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_unproject_undoes_project_exactly(lens: Lens) -> None:
    v, u = np.mgrid[0:241:20, 0:321:20].astype(float)
    pixels = np.stack([u, v], axis=-1)
    rays = unproject(lens, pixels)
    assert rays.shape == (*pixels.shape[:-1], 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(project(lens, rays * 3.7), pixels, atol=1e-10)
