"""Training's additions to the rasteriser, at high contrast: losses, pruning, growth, storage."""

import importlib
from typing import Any

import numpy as np
import pytest
import torch

from imaging.errors import InputError
from recon.data.light import Light
from recon.observe.linear import LIGHT_MU
from recon.observe.losses.photometric import Photometric, mu_law
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.gaussians import Gaussians
from recon.splat import SplatStats, rasterize
from recon.train.densification import OPACITY, Density, DensityRules


@pytest.mark.parametrize("loss", ["mu-law", "log over a floor"])
def test_zero_background_keeps_a_finite_gradient(scene_of: Any, dtype: torch.dtype, loss: str) -> None:
    """Pixels that show exactly nothing pull, and with a bounded force: mu-law, or a floor of 2^-20."""
    scene = scene_of("small")
    scene.background = torch.zeros(3).double()
    tensors = scene.tensors(dtype)
    image = scene.render(tensors).image
    assert (image == 0).any()
    assert (image > 0).any()
    if loss == "mu-law":
        steepest = LIGHT_MU / np.log1p(LIGHT_MU)
        (mu_law(image, LIGHT_MU) - 1).square().sum().backward()
    else:
        steepest = 2.0**20
        torch.log2(image + 2.0**-20).sum().backward()
    assert all(torch.isfinite(tensor.grad).all() for tensor in tensors)
    force = tensors[5].grad.abs()
    assert (force > 0).all()
    assert (force <= 2 * steepest * image[..., 0].numel()).all()


@pytest.mark.parametrize(
    ("name", "gain"),
    [("nh_3dgs", 1.0), ("nh_3dgs", 2.0**20), ("hdr_gs", 1.0), ("hdr_gs", 2.0**20), ("vanilla", 1.0)],
)
def test_ssim_sees_values_of_display_size(toy_dataset: Any, toy_ldr: Any, name: str, gain: float) -> None:
    """Its constants are for 0..1: targets lie there, and even a render 2^20 too bright is near it.

    (The renders of `vanilla` are display values, not light.)
    """
    dataset = toy_dataset
    if name != "nh_3dgs":
        dataset = importlib.import_module("recon.data.load").load(toy_ldr)
    method = importlib.import_module(f"recon.methods.{name}").compose(dataset, Light(100.0, 2.0**-20))
    view = dataset.train[0]
    image = torch.rand(view.lens.height, view.lens.width, 3, generator=torch.Generator().manual_seed(0))
    image = (image * gain).requires_grad_()
    prediction, target = method.observation.compare(image, view, 0.5)
    assert float(target.min()) >= -0.5
    assert float(target.max()) <= 1.0 + 1e-5
    assert prediction.detach().abs().max() < 4
    loss = Photometric(0.8)(prediction, target)
    assert 0 <= float(loss.detach()) < 4
    loss.backward()
    assert torch.isfinite(image.grad).all()


def veil(opacities: list[float], light: list[float]) -> Gaussians:
    """Wide Gaussians, one behind the other, grey and opaque as told."""
    n = len(light)
    appearance = LuminanceChromaticity()
    return Gaussians(
        {
            "means": torch.tensor([[0.0, 0.0, 2.0 + i] for i in range(n)]),
            "log_scales": torch.zeros(n, 3),
            "quats": torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
            "opacity_logits": torch.logit(torch.tensor(opacities)),
            **appearance.start(torch.tensor(light)[:, None].repeat(1, 3)),
        }
    )


def test_pruning_takes_only_what_is_dim(axial_camera: Any) -> None:
    """Prune what showed less than the least opacity times the reference; a faint veil of a lamp stays."""
    reference, rules = 1e-3, DensityRules(cap=8)
    light = torch.tensor([1e3, 1.0, 1e-3, 1e-5, 1e-3, 1e3])
    gaussians = veil([1e-3, 1e-3, 5e-3, 5e-3, 0.5, 1e-9], light.tolist())
    density = Density(rules, reference)
    change = density.adapt(gaussians, light, SplatStats(6), 0.3, torch.Generator().manual_seed(0))
    assert change.keep.tolist() == [True, True, False, False, True, False]
    gone = ~change.keep
    tensors = [gaussians.parameters["means"], gaussians.parameters["quats"], torch.ones(6, 3)]
    tensors += [gaussians.opacities(), light[:, None].repeat(1, 3)]
    image = rasterize(*[tensor.detach()[gone] for tensor in tensors], axial_camera).image
    assert float(image.max()) <= int(gone.sum()) * OPACITY * reference


@pytest.mark.parametrize("power", [-40, -13, 20, 40])
def test_growth_does_not_depend_on_the_size_of_the_loss(power: int) -> None:
    """Radiance times 2^k makes gradients times 2^k: the same Gaussians are split."""
    chosen = []
    for factor in (1.0, 2.0**power):
        gaussians = veil([0.5] * 12, [1.0] * 12)
        stats = SplatStats(12)
        stats.tension[:] = torch.from_numpy(np.random.default_rng(0).uniform(0.1, 1, 12) * factor)
        density = Density(DensityRules(cap=20, begin=0.0, end=0.1), 1e-3)
        change = density.adapt(gaussians, torch.ones(12), stats, 0.3, torch.Generator().manual_seed(0))
        chosen.append(change.keep.tolist())
    assert chosen[0] == chosen[1]
    assert not all(chosen[0])


def test_half_precision_is_refused(scene_of: Any) -> None:
    """Its exponential overflows at 11 and its mu-law at 13: it is for storage only."""
    scene = scene_of("plain")
    for kind in (torch.float16, torch.bfloat16):
        with pytest.raises(InputError, match=str(kind)):
            rasterize(*scene.tensors(kind, grad=False), scene.camera)
