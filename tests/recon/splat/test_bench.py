"""The peer that bench/speed/splat.py measures against computes what we compute."""

import pytest
import torch

from bench.speed import peers
from recon.splat import Limits, rasterize
from recon.stability.workloads import view, workload


@pytest.mark.parametrize("name", ["object", "room"])
def test_peer_agrees(name: str) -> None:
    tensors, camera = workload(name, 1500), view(name, 70, 50)
    pull = torch.randn(50, 70, 3, generator=torch.Generator().manual_seed(0))
    images, gradients = [], []
    for render in (
        lambda: rasterize(*tensors, camera, limits=Limits.gsplat()).image,
        lambda: peers.torch_tiles(tensors, camera, peers.tile_lists(tensors, camera)),
    ):
        image = render()
        images.append(image.detach())
        gradients.append(torch.autograd.grad(image, tensors, pull))
    assert images[0].mean() > 0.05
    assert (images[0] - images[1]).abs().mean() < 1e-5
    for ours, theirs in zip(*gradients, strict=True):
        # The peer clamps alpha, we clamp the opacity: at most 1e-3 of either.
        assert (ours - theirs).norm() < 2e-3 * theirs.norm()
