"""The Triton kernels compile for GPUs that are not there, and fit them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("triton", reason="Triton is for Linux")

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
