"""The Triton kernels compile for GPUs that are not there, and fit them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("triton", reason="Triton is for Linux")

ARCHITECTURES = (80, 90)


def test_every_kernel_compiles_and_spills_next_to_nothing() -> None:
    """For A100 and H100: a cubin each, at most 48 kB of shared memory, at most 256 bytes a thread spilled.

    Triton keeps what it compiled, by a hash of the kernel and of itself: half a minute once on a machine.
    """
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    command = [sys.executable, str(Path(__file__).with_name("compile_kernels.py")), *map(str, ARCHITECTURES)]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=240)
    assert result.returncode == 0, result.stderr
    compiled = json.loads(result.stdout)
    assert len({(one["kernel"], one["architecture"]) for one in compiled}) == 7 * len(ARCHITECTURES)
    for one in compiled:
        assert one["elf"], one
        assert one["shared"] <= 48 * 1024, one
        assert one["REG"] <= 255, one
        assert one["STACK"] <= 256, one
    tiles = [one for one in compiled if one["kernel"].startswith("composite")]
    assert all(one["REG"] <= 160 for one in tiles), tiles  # room for 12 warps on a multiprocessor
