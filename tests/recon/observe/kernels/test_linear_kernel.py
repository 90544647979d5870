"""The one pass over linear light against its formula in float64, plain operations and finite differences."""

import numpy as np
import pytest
import torch

import imaging.compute.threads as threads
from imaging.sensor.cfa import Cfa
from imaging.session.calibration import Response
from recon.data.dataset import Sensor, View
from recon.data.shot import HeldPlanes, Shot
from recon.observe.linear import SIGNAL_MU, LinearLight
from recon.splat import SplatCamera

MATRIX = np.array([[0.7, 0.2, -0.05], [0.1, 0.8, 0.1], [-0.02, 0.3, 0.9], [0.3, 0.3, 0.3]])
SCALES = (0.02, 0.3, 2.0)
TILES = [(Cfa.RGGB, 6, 10), (Cfa.GBRG, 70, 34), (Cfa.X_TRANS, 12, 18), (Cfa.KODAK_RGBW, 8, 12), (None, 5, 7)]


def make_view(cfa: Cfa | None, height: int, width: int, whole: bool = False) -> View:
    """Shots of noise; some samples are saturated and some are not valid, unless it is whole."""
    rng = np.random.default_rng(3)
    matrix = MATRIX[: 3 if cfa is None else len(cfa.letters)]
    shape, shots = (height, width, 3)[: 3 if cfa is None else 2], []
    for k in SCALES:
        pixels = rng.uniform(-0.02, 1, shape).astype(np.float32)
        saturated, valid = rng.random(shape) < 0.2, rng.random(shape) < 0.9
        none = np.zeros(shape, bool)
        shots.append(
            Shot("file", k, HeldPlanes(pixels, none if whole else saturated, none, ~none if whole else valid))
        )
    falloff = rng.uniform(0.6, 1.1, (height, width)).astype(np.float32)
    sensor = Sensor("raw", cfa, matrix, falloff, Response(kind="linear", evidence="test"))
    lens = SplatCamera(np.eye(4), 10.0, 10.0, width / 2, height / 2, width, height)
    return View("cam", 0, lens, sensor, tuple(shots))


def light(height: int, width: int, seed: int = 0) -> torch.Tensor:
    """Light of eight decades, a little of it below zero."""
    rng = np.random.default_rng(seed)
    image = 10 ** rng.uniform(-6, 2, (height, width, 3)) * np.where(
        rng.random((height, width, 3)) < 0.1, -1, 1
    )
    return torch.from_numpy(image.astype(np.float32))


@pytest.mark.parametrize(("cfa", "height", "width"), TILES)
@pytest.mark.parametrize("whole", [True, False])
def test_shots_and_their_gradient_are_those_of_float64(
    cfa: Cfa | None, height: int, width: int, whole: bool
) -> None:
    """Against the plain operations, which other tests hold against the formula pixel by pixel."""
    view, observation = make_view(cfa, height, width, whole), LinearLight(2.0)
    factors = torch.tensor([0.7, 1.0, 1.3])
    results = []
    for dtype in (torch.float32, torch.float64):
        image = light(height, width).to(dtype).requires_grad_()
        factor = factors.to(dtype).requires_grad_()
        prediction, _ = observation.compare(image, view, 0.5, factor)
        pull = torch.rand(prediction.shape, generator=torch.Generator().manual_seed(1)) - 0.5
        results.append((prediction, *torch.autograd.grad(prediction, (image, factor), pull.to(dtype))))
    (ours, *slopes), (theirs, *exact) = results
    # Sums of the matrix lose digits where they cancel.
    torch.testing.assert_close(ours.double(), theirs, rtol=4e-7, atol=2e-6)
    assert (slopes[0] - exact[0]).norm() <= 2e-6 * exact[0].norm()
    torch.testing.assert_close(slopes[1].double(), exact[1], rtol=2e-6, atol=2e-6)


@pytest.mark.parametrize(("cfa", "height", "width"), TILES)
def test_gradient_equals_finite_differences(cfa: Cfa | None, height: int, width: int) -> None:
    view, observation = make_view(cfa, height, width, whole=True), LinearLight(2.0)
    image = light(height, width).requires_grad_()
    prediction, target = observation.compare(image, view, 0.5)
    ((prediction - target) ** 2).sum().backward()
    direction = image.detach().double() * torch.from_numpy(np.random.default_rng(5).normal(size=image.shape))
    at, ends = image.detach().double(), []
    for sign in (1, -1):
        shown, _ = observation.compare(at + sign * 1e-5 * direction, view, 0.5)
        ends.append(((shown - target) ** 2).sum())
    slope = float(ends[0] - ends[1]) / 2e-5
    assert float((image.grad * direction).sum()) == pytest.approx(slope, rel=2e-5)


def test_the_logarithm_keeps_its_digits_from_the_dark_to_the_sun() -> None:
    width = 4000
    view = make_view(None, 1, width, whole=True)
    view.sensor.falloff[:] = 1
    signal = np.concatenate([-np.geomspace(1e-3, 1e12, width // 2), np.geomspace(1e-12, 1e20, width // 2)])
    matrix = np.eye(3)
    sensor = Sensor("raw", None, matrix, view.sensor.falloff, view.sensor.response)
    view = View("cam", 0, view.lens, sensor, tuple(shot for shot in view.shots))
    image = torch.from_numpy(signal.astype(np.float32))[None, :, None].repeat(1, 1, 3)
    prediction, _ = LinearLight(1 / SCALES[1]).compare(image, view, 0.5)
    bend = np.float32(SIGNAL_MU) * np.abs(signal.astype(np.float32)) + np.float32(1)
    exact = np.sign(signal) * np.log(bend.astype(np.float64)) / np.log1p(SIGNAL_MU)
    np.testing.assert_allclose(prediction[3].numpy()[0], exact, rtol=4e-7, atol=2e-8)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_light_that_is_no_number_does_not_become_one(value: float) -> None:
    view, image = make_view(Cfa.RGGB, 6, 10, whole=True), torch.ones(6, 10, 3)
    image[2, 3] = value
    prediction, _ = LinearLight(1.0).compare(image, view, 0.5)
    assert not torch.isfinite(prediction[1::4, 1, 1]).any() or not torch.isfinite(prediction[:, 1, 1]).all()
    assert int((~torch.isfinite(prediction)).sum()) == len(SCALES)


def test_thread_count_changes_no_bit() -> None:
    view, observation = make_view(Cfa.GBRG, 70, 34), LinearLight(2.0)
    before, results = threads.thread_count(), []
    try:
        for count in (1, 2, 3):
            threads.set_threads(count)
            image, factors = light(70, 34).requires_grad_(), torch.ones(3, requires_grad=True)
            prediction, target = observation.compare(image, view, 0.5, factors)
            (prediction - target).square().sum().backward()
            parts = prediction.detach(), image.grad, factors.grad
            results.append(b"".join(part.numpy().tobytes() for part in parts))
    finally:
        threads.set_threads(before)
    assert results[0] == results[1] == results[2]
