"""Light of one to sixteen channels: through the kernels and the oracle, forward and backward."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from imaging.errors import InputError
from recon.splat import Limits, Render, rasterize

COUNTS = (1, 3, 4, 7, 16)
"""One; the usual three; as many as a cache line holds beside the shape; more; the most."""


def coloured(scene: Any, channels: int) -> Any:
    """The scene with as many channels, over a background of as many."""
    rng = np.random.default_rng(channels)
    scene.colours = torch.tensor(rng.uniform(0, 1, (len(scene.means), channels))).float().double()
    scene.background = torch.tensor(rng.uniform(0, 1, channels)).float().double()
    return scene


def pulled(render: Render) -> torch.Tensor:
    """A loss with another gradient at every pixel and in every channel."""
    rng = np.random.default_rng(0)
    a = torch.tensor(rng.normal(size=tuple(render.image.shape)))
    b = torch.tensor(rng.normal(size=tuple(render.alpha.shape)))
    return (a * torch.log1p(render.image.double())).sum() + (b * render.alpha.double()).sum()


@pytest.mark.parametrize("channels", COUNTS)
def test_kernels_equal_the_oracle(scene_of: Callable[[str], Any], channels: int) -> None:
    """Image and every gradient."""
    scene = coloured(scene_of("lens"), channels)
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    render, expected = scene.render(fast), scene.render(truth)
    assert render.image.shape == (scene.camera.height, scene.camera.width, channels)
    torch.testing.assert_close(render.image.double(), expected.image, rtol=1e-5, atol=1e-5)
    pulled(render).backward()
    pulled(expected).backward()
    for ours, theirs in zip(fast, truth, strict=True):
        assert (ours.grad.double() - theirs.grad).norm() < 1e-5 * theirs.grad.norm()


@pytest.mark.parametrize("channels", COUNTS)
def test_gradient_of_the_oracle_equals_finite_differences(
    scene_of: Callable[[str], Any], channels: int
) -> None:
    """Along one direction in all inputs at once, with nothing cut off."""
    scene = coloured(scene_of("lens"), channels)
    scene.limits = Limits(alpha_min=1e-18, t_min=0.0, near=1e-3)
    for name in ("means", "quats", "scales", "opacities", "colours"):
        setattr(scene, name, getattr(scene, name)[:6])
    tensors = scene.tensors(torch.float64)
    pulled(scene.render(tensors)).backward()
    rng = np.random.default_rng(1)
    directions = [torch.tensor(rng.normal(size=tuple(tensor.shape))) for tensor in tensors]
    slopes = []
    for step in (2e-5, 1e-5):
        ends = [
            pulled(
                scene.render([t.detach() + sign * step * d for t, d in zip(tensors, directions, strict=True)])
            )
            for sign in (1, -1)
        ]
        slopes.append((ends[0] - ends[1]) / (2 * step))
    expected = (4 * slopes[1] - slopes[0]) / 3
    shares = [tensor.grad * direction for tensor, direction in zip(tensors, directions, strict=True)]
    assert abs(sum(share.sum() for share in shares) - expected) < 1e-6 * sum(s.abs().sum() for s in shares)


def test_a_channel_does_not_know_the_others(scene_of: Callable[[str], Any]) -> None:
    """Seven channels are seven renders of one, to the last bit."""
    scene = coloured(scene_of("many"), 7)
    *shape, colours, background = scene.tensors(torch.float32, grad=False)
    together = rasterize(*shape, colours, scene.camera, background).image
    for channel in range(7):
        one = slice(channel, channel + 1)
        alone = rasterize(*shape, colours[:, one].contiguous(), scene.camera, background[one]).image
        assert torch.equal(together[:, :, one], alone)


def test_what_cannot_be_drawn_is_counted_in_any_channel(scene_of: Callable[[str], Any]) -> None:
    scene = coloured(scene_of("plain"), 16)
    scene.colours[3, 15] = np.nan
    scene.colours[4, 9] = 1e31
    for dtype in (torch.float32, torch.float64):
        tensors = scene.tensors(dtype)
        render = scene.render(tensors)
        assert render.culled == 2
        render.image.sum().backward()
        assert not tensors[4].grad[3:5].any()


@pytest.mark.parametrize("channels", [0, 17])
def test_no_channel_and_too_many_are_refused(scene_of: Callable[[str], Any], channels: int) -> None:
    scene = coloured(scene_of("plain"), channels)
    with pytest.raises(InputError, match="not \\(N, C\\) with 1 to 16 channels"):
        scene.render(scene.tensors(torch.float32))
