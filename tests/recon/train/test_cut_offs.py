"""The cut-offs that a training draws with are those of its kind of light, and of the scene that it leaves."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imaging.session.calibration import Response
from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.methods import nh_3dgs, vanilla
from recon.methods.method import Method
from recon.observe.photographs import Display
from recon.scene.gaussians import limits_for
from recon.splat import SplatCamera, rasterize
from recon.start.initialisation import Start, gaussians_at
from recon.train.training import Training

LIGHT = Light(normaliser=2.0, reference=1e-3)


def training_of(method: Method) -> Training:
    start = Start(np.random.default_rng(0).normal(size=(20, 3)), np.full((20, 3), 0.5), 20)
    return Training.begin(method, LIGHT, gaussians_at(start, method.appearance, lambda light: light), 1.0)


def test_only_light_has_a_floor_that_depends_on_brightness(toy_dataset: Dataset) -> None:
    linear = nh_3dgs.compose(toy_dataset, LIGHT)
    assert training_of(linear).renderer().limits.luminance_reference == LIGHT.reference
    display = Display(Response(kind="srgb", evidence="test"), 1.0)
    method = Method(name=vanilla.NAME, appearance=vanilla.APPEARANCE, observation=display)
    assert training_of(method).renderer().limits.luminance_reference is None
    # Vanilla on linear light sees light, too.
    raw = replace(vanilla.compose(toy_dataset, LIGHT), appearance=vanilla.APPEARANCE)
    assert training_of(raw).renderer().limits.luminance_reference == LIGHT.reference


@pytest.mark.parametrize("seed", range(3))
def test_display_values_lose_less_than_a_code_by_their_cut_offs(seed: int) -> None:
    """A crowd of Gaussians drawn with the cut-offs of display values, against float64 without any."""
    generator = torch.Generator().manual_seed(seed)

    def drawn(low: float, high: float, *shape: int) -> torch.Tensor:
        return low + (high - low) * torch.rand(*shape, generator=generator)

    count, camera = 60, SplatCamera(np.eye(4), 40.0, 40.0, 16.0, 12.0, 32, 24)
    means = torch.stack([drawn(-1, 1, count), drawn(-1, 1, count), drawn(2, 4, count)], -1)
    parts = [
        means,
        drawn(-1, 1, count, 4),
        drawn(0.02, 0.2, count, 3),
        drawn(0, 1, count),
        drawn(0, 1, count, 3),
    ]
    shown = rasterize(*parts, camera, limits=limits_for(1e-3, display_values=True)).image
    open_ended = replace(limits_for(None), alpha_min=1e-9)
    exact = rasterize(*(part.double() for part in parts), camera, limits=open_ended).image
    off = (shown.double() - exact).abs()
    assert float(off.mean()) < 0.5 / 255
    assert float(off.max()) < 5 / 255
