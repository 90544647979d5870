"""The fisheye by itself: its function and derivatives, the axis, the widest angle and the fold."""

import math
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
import torch

from imaging.compute.jit import kernel
from imaging.errors import ReconstructionError
from imaging.optics import lens as optics
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from recon.splat import Limits, SplatCamera, rasterize
from recon.splat.cpu import lanes
from recon.splat.cpu.formulas import radial, radial_by_terms
from recon.splat.formulas.lens import NEAR_AXIS
from recon.splat.parameters import parameters
from recon.splat.reference import _distort_fisheye

TERMS = (0.08, -0.03, 0.02, -0.008)
SQUARES = [0.0, 1e-12, 1e-4, 0.999 * NEAR_AXIS, NEAR_AXIS, 0.0201, 1.0, 820.0]
CAMERA = SplatCamera(
    np.eye(4), 20, 21, 20.5, 15.5, 40, 30,
    k1=TERMS[0], k2=TERMS[1], k3=TERMS[2], k4=TERMS[3], fisheye=True,
)  # fmt: skip


@kernel
def _functions(squares, k, out):
    s = lanes.load(squares, 0)
    for at, value in enumerate(radial(s, k)):
        lanes.store(out, 8 * at, value)
    by, turn = radial_by_terms(s)
    for at in range(4):
        lanes.store(out, 24 + 8 * at, by[at])
        lanes.store(out, 56 + 8 * at, turn[at])


def _exact(s: float, terms: Any) -> mpmath.mpf:
    r = mpmath.sqrt(s)
    angle = mpmath.atan(r)
    bent = angle * (1 + sum(k * angle ** (2 * i + 2) for i, k in enumerate(terms)))
    return bent / r if s else mpmath.mpf(1)


def test_the_kernels_function_is_exact_on_the_axis_and_far_from_it() -> None:
    """Against arithmetic of 120 digits: the ratio to 1e-14, its derivatives to 1e-10."""
    out = np.empty(88)
    _functions(np.array(SQUARES), parameters(CAMERA, Limits()), out)
    table = out.reshape(11, 8)
    with mpmath.workdps(120):
        for at, s in enumerate(SQUARES):
            place = mpmath.mpf(s) or mpmath.mpf("1e-25")

            def derivative(times: int, terms: Any, place: mpmath.mpf = place) -> float:
                step = place * mpmath.mpf("1e-8")
                ends = [_exact(place + i * step, terms) for i in (-1, 0, 1)]
                if times == 1:
                    return float((ends[2] - ends[0]) / (2 * step))
                return float((ends[2] - 2 * ends[1] + ends[0]) / step**2)

            assert table[0, at] == pytest.approx(float(_exact(place, TERMS)), rel=1e-14)
            assert table[1, at] == pytest.approx(2 * derivative(1, TERMS), rel=1e-10)
            assert table[2, at] == pytest.approx(4 * derivative(2, TERMS), rel=1e-9)
            for i in range(4):
                one = [float(i == j) for j in range(4)]
                none = [0.0] * 4
                apart = float(_exact(place, one) - _exact(place, none))
                assert table[3 + i, at] == pytest.approx(apart, rel=1e-12, abs=1e-20)
                apart = 2 * (derivative(1, one) - derivative(1, none))
                assert table[7 + i, at] == pytest.approx(apart, rel=1e-9, abs=1e-9)


def test_the_oracle_projects_as_the_lens_and_its_jacobian_is_the_derivative() -> None:
    points = np.random.default_rng(0).normal(size=(40, 2)) * np.geomspace(1e-6, 20, 40)[:, None]
    points[0] = 0.0
    u, v = (torch.tensor(column).requires_grad_() for column in points.T)
    x, y, *jacobian = _distort_fisheye(u, v, torch.tensor(TERMS, dtype=torch.float64))
    bent = torch.stack([x, y], dim=1).detach().numpy()
    np.testing.assert_allclose(bent, optics.distort(points, TERMS, fisheye=True), rtol=1e-12, atol=1e-300)
    slopes = [torch.autograd.grad(one.sum(), (u, v), retain_graph=True) for one in (x, y)]
    for slope, expected in zip(jacobian, [s for pair in slopes for s in pair], strict=True):
        torch.testing.assert_close(slope, expected, rtol=1e-9, atol=1e-12)


def gaussian(x: float, y: float, z: float, dtype: torch.dtype) -> list[torch.Tensor]:
    values = [[[x, y, z]], [[1.0, 0, 0, 0]], [[0.02] * 3], [0.9], [[1.0, 1.0, 1.0]]]
    return [torch.tensor(value, dtype=dtype).requires_grad_() for value in values]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_gaussian_on_the_axis_is_round_and_its_gradient_finite(dtype: torch.dtype) -> None:
    tensors = gaussian(0.0, 0.0, 1.0, dtype)
    camera = replace(CAMERA, fy=CAMERA.fx)
    render = rasterize(*tensors, camera)
    alpha = render.alpha.detach()
    torch.testing.assert_close(alpha[15, 20], torch.tensor(0.9, dtype=dtype))
    torch.testing.assert_close(alpha[15, 21], alpha[16, 20])
    render.image[14, 19].sum().backward()
    assert all(torch.isfinite(tensor.grad).all() for tensor in tensors)
    assert tensors[0].grad[0, 0] < 0
    torch.testing.assert_close(tensors[0].grad[0, 0], tensors[0].grad[0, 1])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_what_lies_beyond_the_fold_or_the_widest_angle_is_not_drawn(dtype: torch.dtype) -> None:
    plain = replace(CAMERA, k1=0.0, k2=0.0, k3=0.0, k4=0.0, fx=12.0, fy=12.0)
    folding = replace(plain, k1=-0.4)
    fold = optics.fisheye_fold((-0.4, 0.0, 0.0, 0.0))
    assert 0 < fold < 1
    for camera, angle, visible in (
        (plain, optics.WIDEST - 0.01, 1),
        (plain, optics.WIDEST + 0.01, 0),
        (plain, 2.0, 0),
        (folding, fold - 0.01, 1),
        (folding, fold + 0.01, 0),
    ):
        tensors = gaussian(math.sin(angle), 0.0, math.cos(angle), dtype)
        limits = Limits(near=1e-3)
        assert rasterize(*tensors, camera, None, limits).visible == visible, angle


def test_a_fisheye_from_calibration_and_one_that_sees_too_far() -> None:
    still = Pose(quaternion=(1, 0, 0, 0), translation=(0, 0, 0))
    lens = Lens(
        model="OPENCV_FISHEYE", width=80, height=60, fx=40, fy=41, cx=40, cy=30,
        k1=0.01, k2=0.02, k3=0.003, k4=0.004,
    )  # fmt: skip
    camera = SplatCamera.of(lens, still)
    assert camera.lens == lens.terms == (40, 41, 40, 30, 0.01, 0.02, 0.003, 0.004)
    wide = lens.model_copy(update={"fx": 30.0, "fy": 30.0, "k1": 0.0, "k2": 0.0, "k3": 0.0, "k4": 0.0})
    with pytest.raises(ReconstructionError, match="sees 95 degrees from its axis"):
        SplatCamera.of(wide, still)
    with pytest.raises(ReconstructionError, match="folds over"):
        SplatCamera.of(wide.model_copy(update={"k1": -0.4}), still)
