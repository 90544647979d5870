"""The memory that a training was said to take, and took: the peak of a process of its own.

    python -m bench.real.memory [--sets demo,lego] [--quick] [--json] [--write] [--seeds 1] [--work FOLDER]
    python -m bench.real.memory --at-size [--quick] [--json] [--write] [--seeds 1] [--work FOLDER]

The second says what each view and each Gaussian adds, with images in memory or on the disk, of brackets of
the simulator whose cells are repeated to the pixels of a camera (`bench/support/enlarged.py`). Sets as in
`bench/peers/compare.py`, and the simulated brackets of `rig demo`, RAW. Peaks are kept in FOLDER, forecasts
are made again. Few iterations: nothing grows with them but the Gaussians, which start at half of their number
and reach it at 60 % of any length.
"""

import argparse
import json
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from bench.peers.compare import session_of
from bench.support.enlarged import enlarged
from bench.support.oracle import oracle_session
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from drivers.sim.rig_settings import RIGS

SETTINGS = {
    "demo": ((320, 20_000),),
    "lego": ((400, 40_000),),
    "fox": ((640, 40_000),),
    "castle": ((1280, 80_000), (320, 300_000)),
    "banana": ((1280, 80_000),),
}
"""Width, px, and Gaussians of each set's trainings; last of the castle, many on small pictures."""
ITERATIONS = 40
PEAK = """
def status(name):
    line = next(line for line in open("/proc/self/status") if line.startswith(name))
    return 1024 * int(line.split()[1])
"""
"""A process's own figures: `ru_maxrss` is the memory of the process that began it where that is more."""
_ASKED = f"""
import json, sys
from pathlib import Path
from imaging.compute import memory
from recon.decide.overrides import Overrides
import recon.reconstruct as stage
from recon.decide.request import TrainingRequest
{PEAK}
session, width, gaussians, seed = Path(sys.argv[1]), *map(int, sys.argv[2:])
overrides = Overrides(
    width=width, gaussians=gaussians, iterations={ITERATIONS}, refine="none", environment=False
)
request = TrainingRequest(
    quality="best", overrides=overrides, seed=seed, name="memory", replace=True
)
"""
_FORECAST = f"""{_ASKED}
from imaging.compute.threads import thread_count
from recon.decide.cost.memory_need import forecast
room = memory.available() + memory.resident()
print(json.dumps({{"forecast": forecast(session, room, thread_count(), request)}}))
"""
_RUN = f"""{_ASKED}
stage.reconstruct(session, request, shelf="memory")
print(json.dumps({{"peak": status("VmHWM")}}))
"""


FACTOR = 31
"""Times 64x48: 1984x1488, 3 MP."""
TRAININGS = ((6, False), (12, False), (6, True), (12, True))
"""Views, and whether their images stay on the disk."""
GAUSSIANS, DEGREES = 1_000_000, (0, 1, 2)
_TRAINING = f"""
import json, sys, time
import recon.decide.cost.memory_need as deciding
import recon.reconstruct as stage
from recon.decide.request import TrainingRequest
from recon.decide.cost.memory_need import Need, need
from recon.decide.overrides import Overrides
{PEAK}
session, stored, seed = sys.argv[1], sys.argv[2] == "True", int(sys.argv[3])
Need.too_large = lambda self, free: stored
needs = []
deciding.need = lambda *views, **how: needs.append(need(*views, **how)) or needs[-1]
overrides = Overrides(width=4096, gaussians=20000, iterations=12, refine="none", environment=False)
request = TrainingRequest(
    quality="draft", overrides=overrides, seed=seed, name="memory", replace=True
)
stage.reconstruct(session, request, shelf="memory")
print(json.dumps(dict(forecast=needs[-1].total, peak=status("VmHWM"), seconds=time.process_time())))
"""
_STEPS = f"""
import json, math, sys
import numpy as np, torch
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.gaussians import Gaussians, GeometryRates, Renderer, limits_for
from recon.splat import SplatCamera, SplatStats
from recon.train.adam import Adam
from recon.train.densification import Density, DensityRules
from recon.train.devices.warm_up import warm_up
{PEAK}
count, degree = int(sys.argv[1]), int(sys.argv[2])
warm_up(lambda *arguments: None)
before = status("VmRSS")
drawn, looks = torch.Generator().manual_seed(0), LuminanceChromaticity()
place = torch.rand(count, 3, generator=drawn) * torch.tensor([4.0, 3.0, 4.0]) - torch.tensor([2.0, 1.5, -2.0])
quats = torch.zeros(count, 4)
quats[:, 0] = 1
scene = Gaussians(dict(
    means=place, log_scales=torch.full((count, 3), math.log(2 / count ** (1 / 3))), quats=quats,
    opacity_logits=torch.full((count,), 0.8), **looks.start(torch.rand(count, 3, generator=drawn)),
))
del place, quats
adam = Adam([dict(name=n, params=[v.requires_grad_(True)], lr=1e-4) for n, v in scene.parameters.items()])
stats = SplatStats(count)
camera = SplatCamera(np.eye(4), fx=500.0, fy=500.0, cx=320.0, cy=240.0, width=640, height=480)
renderer = Renderer(looks, limits_for(1e-3))
for _ in range(2):
    renderer(scene, camera, degree=degree, stats=stats).image.mean().backward()
    adam.step()
    held = sum(v.nbytes + (0 if v.grad is None else v.grad.nbytes) for v in scene.parameters.values())
    held += sum(value.nbytes for value in adam.tensors().values())
    adam.zero_grad()
step = status("VmHWM")
density = Density(DensityRules(count + count // 4), 1e-3)
luminance = looks.luminance(scene.parameters)
density.adapt(scene, luminance, stats, 0.5, drawn).apply(scene, adam)
print(json.dumps(dict(
    held=held / count, step=(step - before) / count, growth=(status("VmHWM") - before) / count
)))
"""


def last(script: str, *options: object) -> dict[str, Any]:
    """Return what a script prints last."""
    command = [sys.executable, "-c", script, *map(str, options)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{options} failed:\n{done.stderr[-2000:]}")
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return row


def large_session(work: Path, views: int) -> Path:
    """Make a calibrated session of that many large views."""
    name = f"toy-{views}"
    RIGS[name] = replace(RIGS["toy"], positions=views // 2)
    small = oracle_session(work / name, name, points=600)
    return enlarged(small, work / f"{name}-{FACTOR}", FACTOR)


def set_session(name: str, work: Path) -> Path:
    """Make a calibrated session of a set."""
    return oracle_session(work / "demo", "demo") if name == "demo" else session_of(name, work)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "memory.jsonl")
    rows = []
    for name in options.sets.split(","):
        session = set_session(name, options.work)
        for width, gaussians in SETTINGS[name]:
            for seed in range(options.seeds):
                asked = (session, width, gaussians, seed)
                peak = cache.get(f"{name} {width} {gaussians} {seed}", partial(last, _RUN, *asked))
                what = {"set": name, "width": width, "gaussians": gaussians, "seed": seed}
                rows.append(what | peak | last(_FORECAST, *asked))
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# The memory that a training was said to take, and took",
        "",
        f"`python -m bench.real.memory --write`: {ITERATIONS} iterations. The forecast was fitted to these "
        f"trainings. {words(result['machine'])}.",
        "",
        "| set | width, px | Gaussians | forecast, GB | peak, GB | forecast off, % |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        lines.append(
            f"| {row['set']} | {row['width']} | {row['gaussians']:,} | {row['forecast'] / 1e9:.2f} "
            f"| {row['peak'] / 1e9:.2f} | {100 * (row['forecast'] / row['peak'] - 1):+.0f} |"
        )
    return "\n".join(lines) + "\n"


def measure_at_size(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "memory-at-size.jsonl")
    trainings, gaussians = [], []
    for views, stored in TRAININGS[2:3] if options.quick else TRAININGS:
        for seed in range(options.seeds):
            session = large_session(options.work, views)
            row = cache.get(f"{views} {stored} {seed}", partial(last, _TRAINING, session, stored, seed))
            trainings.append({"views": views, "stored": stored} | row)
    count = GAUSSIANS // 10 if options.quick else GAUSSIANS
    for degree in DEGREES:
        row = cache.get(f"{count} degree {degree}", partial(last, _STEPS, count, degree))
        gaussians.append({"count": count, "degree": degree} | row)
    return {"machine": machine(), "trainings": trainings, "gaussians": gaussians}


def report_at_size(result: dict[str, Any]) -> str:
    lines = [
        "# What views and Gaussians add to the memory of a training",
        "",
        "`python -m bench.real.memory --at-size --write`: brackets of three RAW exposures of 64x48, "
        f"their cells repeated to {64 * FACTOR}x{48 * FACTOR}, trained at that width, 20,000 Gaussians, 12 "
        f"iterations. "
        f"{words(result['machine'])}.",
        "",
        "| views | images | forecast, GB | peak, GB | forecast off, % | processor s |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["trainings"]:
        lines.append(
            f"| {row['views']} | {'on the disk' if row['stored'] else 'in memory'} "
            f"| {row['forecast'] / 1e9:.2f} | {row['peak'] / 1e9:.2f} "
            f"| {100 * (row['forecast'] / row['peak'] - 1):+.0f} | {row['seconds']:.0f} |"
        )
    lines += [
        "",
        "Of a Gaussian, bytes: its numbers with gradients and both averages of Adam; the peak of a step, "
        "with the tables of a render of 640x480 in which all are seen; the peak where their number changes. "
        "The harmonics end at degree 2.",
        "",
        "| Gaussians | degree | numbers, gradient, Adam | peak of a step | peak of growth |",
        "|---|---|---|---|---|",
    ]
    for row in result["gaussians"]:
        lines.append(
            f"| {row['count']:,} | {row['degree']} | {row['held']:.0f} "
            f"| {row['step']:.0f} | {row['growth']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", default=",".join(SETTINGS), help="comma-separated")
    parser.add_argument("--at-size", action="store_true")
    options = parser.parse_args()
    if options.quick:
        options.sets = "demo"
    if options.at_size:
        result = measure_at_size(options)
        deliver(options, "memory_at_size", result, report_at_size(result))
    else:
        result = measure(options)
        deliver(options, "memory", result, report(result))


if __name__ == "__main__":
    main()
