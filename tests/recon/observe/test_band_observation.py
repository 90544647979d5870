"""Renders seen by mono cameras behind filters, against the definition."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from recon.data.shot import HeldPlanes, Shot
from recon.observe.band_observation import BandedLight
from recon.observe.linear import SIGNAL_MU
from recon.observe.losses.photometric import mu_law

RNG = np.random.default_rng(0)
SIZE = (6, 8)


def shot(band: int, k: float, saturated: bool = False) -> Shot:
    pixels = RNG.uniform(0, 1, SIZE).astype(np.float32)
    valid = np.ones(SIZE, bool)
    valid[0, :2] = False
    return Shot("", k, HeldPlanes(pixels, np.full(SIZE, saturated), np.zeros(SIZE, bool), valid), band=band)


def view(*shots: Shot) -> Any:
    falloff = RNG.uniform(0.5, 1, SIZE).astype(np.float32)
    return SimpleNamespace(
        held=True,
        name="0000/cam0",
        lens=SimpleNamespace(width=SIZE[1]),
        shots=shots,
        sensor=SimpleNamespace(falloff=falloff, glare=0.0),
    )


def test_each_shot_shows_its_band_at_its_exposure() -> None:
    banded = view(shot(0, 0.5), shot(0, 2.0), shot(4, 1.0))
    image = torch.rand(*SIZE, 5, requires_grad=True)
    factors = torch.tensor([1.0, 1.5, 0.8], requires_grad=True)
    prediction, target = BandedLight(3.0).compare(image, banded, 0.0, factors)
    assert prediction.shape == target.shape == (3, *SIZE)
    for row, (one, factor) in enumerate(zip(banded.shots, (1.0, 1.5, 0.8), strict=True)):
        signal = image[:, :, one.band] * torch.from_numpy(banded.sensor.falloff) * (3.0 * one.k * factor)
        expected = mu_law(signal, SIGNAL_MU)
        valid = torch.from_numpy(one.valid)
        torch.testing.assert_close(prediction[row][valid], expected[valid])
        assert torch.equal(prediction[row][~valid], target[row][~valid])
        torch.testing.assert_close(BandedLight(3.0).predict(image, banded, one.k * factor, one.band), signal)
    prediction.sum().backward()
    assert image.grad is not None
    assert not image.grad[:, :, 1:4].any()
    assert image.grad[1:, :, 0].all()
    assert image.grad[1:, :, 4].all()
    assert factors.grad is not None
    assert factors.grad.all()


def test_a_saturated_shot_asks_for_at_least_its_light() -> None:
    banded = view(shot(1, 1.0, saturated=True))
    prediction, target = BandedLight(1.0).compare(torch.full((*SIZE, 2), 50.0), banded, 0.0)
    assert torch.equal(prediction, target)
