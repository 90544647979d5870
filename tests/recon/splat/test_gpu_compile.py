"""The Triton kernels compile for GPUs that are not there, and fit them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch

pytest.importorskip("triton", reason="Triton is for Linux")

from triton.backends.amd.compiler import HIPOptions
from triton.backends.nvidia.compiler import CUDAOptions

from recon.splat.gpu import rasterizer

ROOT = Path(__file__).parents[3]


def test_every_kernel_compiles_and_spills_next_to_nothing() -> None:
    """For a GPU of each make; `bench/speed/gpu_kernels.py` has the others.

    Triton keeps what it compiled, by a hash of the kernel and of itself: half a minute once on a machine.
    """
    command = [sys.executable, "-m", "bench.speed.gpu_kernels", "--quick", "--json"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240, check=False)
    assert result.returncode == 0, result.stdout[-400:] + result.stderr
    made = json.loads(result.stdout)
    assert {row["target"] for row in made["rows"]} == {"sm_80", "gfx942"}
    assert len({row["kernel"] for row in made["rows"]}) == 10
    assert made["beyond"] == []


@pytest.mark.parametrize(("hip", "options"), [(None, CUDAOptions), ("6.4", HIPOptions)])
def test_a_launch_has_the_options_of_its_make(
    hip: str | None, options: type, scene_of, device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The launch of a kernel refuses an option that the compiler of its GPU does not know."""
    given: dict[str, object] = {}
    kernel = rasterizer.composite_backward

    class Launch:
        def __getitem__(self, grid: tuple[int]):
            return lambda *arguments, **named: (given.update(named), kernel[grid](*arguments, **named))

    monkeypatch.setattr(rasterizer, "composite_backward", Launch())
    monkeypatch.setattr(torch.version, "hip", hip)
    scene = scene_of("one").smaller(1)
    scene.render_on(device, scene.tensors(torch.float32)).image.sum().backward()
    assert ("maxnreg" in given) == (hip is None)
    assert set(given) - set(kernel.arg_names) <= set(options.__dataclass_fields__)
