"""The peer that bench/speed/splat.py measures against computes what we do; an hour on a GPU needs one."""

import os
import subprocess
import sys
from pathlib import Path

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


def test_an_hour_on_a_gpu_is_refused_in_a_sentence_without_one() -> None:
    script = Path(__file__).parents[3] / "bench" / "speed" / "gpu.sh"
    environment = os.environ | {"PYTHON": sys.executable, "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run([script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == (
        "bench/speed/gpu.py: torch and Triton see no GPU here, so there is nothing to measure.\n"
    )
