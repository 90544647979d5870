"""A training whose decoded images are larger than the memory that it may take."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from bench.support.enlarged import enlarged
from bench.support.oracle import oracle_session
from drivers.sim.rig_settings import RIGS
from imaging.files import store
from recon.result.model import SPLATS
from tests.conftest import MadeOnce

ITERATIONS = 3
LIMIT = 410 << 20
"""Bytes that the limited process may take beyond what it has when its kernels are loaded; threads set aside
128 MB of them."""
LIMITED = f"""
import resource, sys
from dataclasses import replace
from pathlib import Path
import recon.decide.cost.memory_need as deciding
import recon.reconstruct as stage
from recon.decide.cost.memory_need import need
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.train.devices.warm_up import warm_up
warm_up(lambda *told: None)
first = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
before = resource.getrlimit(resource.RLIMIT_AS)
resource.setrlimit(resource.RLIMIT_AS, (first + {LIMIT}, before[1]))
needs = []
deciding.need = lambda *views, **how: needs.append(need(*views, **how)) or needs[-1]
overrides = Overrides(iterations={ITERATIONS}, gaussians=1000, width=640, refine="none", environment=False)
request = TrainingRequest(quality="draft", overrides=overrides)
folder = stage.reconstruct(sys.argv[1], replace(request, name="limited"), on_message=print)
evaluate(folder)
peak = 1024 * int(next(
    line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")
).split()[1])
print(len(needs), needs[0].images, needs[-1].total, peak)
resource.setrlimit(resource.RLIMIT_AS, before)
evaluate(stage.reconstruct(sys.argv[1], replace(request, name="whole")))
"""


@pytest.fixture(scope="module")
def large(made_once: MadeOnce) -> Path:
    """Thirty photographs of 640x480."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(RIGS, "many", replace(RIGS["toy-ldr"], positions=15))
            small = oracle_session(folder.with_name(f"{folder.name}-small"), "many", points=600)
        enlarged(small, folder, 10, exposures=1)

    return made_once("recon-large", make)


@pytest.mark.skipif(sys.platform != "linux", reason="address space is limited on Linux")
def test_images_that_memory_does_not_hold_give_the_same_scene(large: Path) -> None:
    words = [sys.executable, "-c", LIMITED, str(large)]
    # Every thread of every library sets aside address space: the limit is for two of them on any machine.
    threads = {"OMP_NUM_THREADS": "2", "NUMBA_NUM_THREADS": "2", "MALLOC_ARENA_MAX": "4"}
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=os.environ | threads)
    assert done.returncode == 0, done.stderr
    *lines, figures = done.stdout.splitlines()
    count, images, forecast, peak = map(int, figures.split())
    assert count == 2, "held in memory"
    assert images > LIMIT - (128 << 20)
    assert any("images stay on the disk" in line and str(large / "decoded") in line for line in lines)
    assert peak < forecast
    whole, limited = (large / "reconstructions" / name for name in ("whole", "limited"))
    assert (whole / SPLATS).read_bytes() == (limited / SPLATS).read_bytes()
    in_memory, from_disk = (store.read_json(folder / "metrics.json")["views"] for folder in (whole, limited))
    # Sums of arrays that lie elsewhere in memory may differ in their last bit.
    for one, other in zip(in_memory, from_disk, strict=True):
        assert one.pop("view") == other.pop("view")
        assert one == pytest.approx(other, rel=1e-12)
