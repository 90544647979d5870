"""OpenSplat (C++, AGPL-3.0, https://github.com/WebODM/OpenSplat) as its users run it on a CPU.

It is built here from its source: `git clone` of the newest release, cmake, libtorch of the installed torch,
and OpenCV's headers (`apt install libopencv-dev`). It knows no budget of time, so its number of iterations is
found that takes as many processor seconds as rig is given, and its schedule, which is meant for 30,000, is
shortened in proportion. It grows four times, or every 500 iterations where that is more often; fewer times
only where the part of its run in which it may grow ends by the 20th iteration.
"""

import math
import os
import re
import resource
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import torch

from bench.support.record import commit_of
from imaging.files import store

SOURCE = "https://github.com/WebODM/OpenSplat"
RELEASE = "v1.2.0"
BACKGROUND = (0.0, 0.0, 0.0)
"""Background behind its Gaussians: a constant of its source."""
GROWTHS = 4
"""Times that a short run grows."""
INTERVAL = 500
"""Iterations from one growth to the next in its own schedule, which begins after as many."""
NO_GROWTH = 16
"""Step up to which it cannot grow: it ends with a fault until its harmonics had their first step."""
WHOLE = 30_000
"""Iterations that its schedule is made for."""


@dataclass(frozen=True)
class Variant:
    """A way to run it. downscales: how many times its first pictures are halved. growing: share of its
    iterations in which it grows; after them it steps in every 32nd and 64th alone, which short runs lack.
    """

    name: str
    downscales: int
    growing: float


VARIANTS = (
    Variant("full size", 0, 0.5),
    Variant("coarse to fine", 2, 0.5),
    Variant("coarse to fine, growing throughout", 2, 1.0),
)
CLOSE = 0.08
"""A run may take this share more or less than the budget."""
TRIES = 7
GROWTH = 0.75
"""Exponent of its iterations over its seconds, roughly: its pace falls as its scene grows."""


@dataclass(frozen=True)
class Outcome:
    """A run: its file, its iterations, and the processor seconds that it took."""

    ply: Path
    iterations: int
    seconds: float


def built(work: Path, source: Path | None = None) -> Path:
    """The program, built once in `work`; source: a checkout in place of a clone of `RELEASE`."""
    build = work / (f"build-{RELEASE}" if source is None else f"build-{commit_of(source)}")
    program = build / "opensplat"
    if program.is_file():
        return program
    if source is None:
        source = work / f"source-{RELEASE}"
        if not source.is_dir():
            _run(["git", "clone", "--depth", "1", "--branch", RELEASE, SOURCE, str(source)])
    options = [
        "-DGPU_RUNTIME=CPU",
        "-DCMAKE_BUILD_TYPE=Release",
        "-DCMAKE_CXX_FLAGS=-march=native",
        "-DFETCHCONTENT_TRY_FIND_PACKAGE_MODE=ALWAYS",
        f"-DCMAKE_PREFIX_PATH={torch.utils.cmake_prefix_path}",
    ]
    _run(["cmake", "-S", str(source), "-B", str(build), *options])
    _run(["cmake", "--build", str(build), "--parallel", "2"])
    return program


def version(program: Path) -> str:
    """Version as it prints it."""
    return subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout.strip()


def trained(program: Path, folder: Path, budget: float, variant: Variant, out: Path) -> Outcome:
    """The run of a nerfstudio folder that takes about `budget` processor seconds; kept once it is done, until
    `schedule` has other options for it.
    """
    record = out / f"{variant.name.replace(', ', '-').replace(' ', '-')}-{budget:g}.json"
    ply = record.with_suffix(".ply")
    if record.is_file():
        finished = store.read_json(record)
        if finished.get("options") == schedule(variant, finished["iterations"]):
            return Outcome(ply, finished["iterations"], finished["seconds"])
        record.unlink()
    out.mkdir(parents=True, exist_ok=True)
    fewest, most, iterations, seconds = 0, 0, 30, 0.0
    best: tuple[int, float] | None = None
    part = ply.with_suffix(".part.ply")
    for _ in range(TRIES):
        seconds, reached = _iterated(program, folder, iterations, variant, part, (1 + CLOSE) * budget)
        if reached < iterations:
            most = iterations
            # A shorter run has grown as far when it ends as this one would have, so that it is slower.
            ahead = 0.9 * reached
        else:
            fewest, best = iterations, (iterations, seconds)
            part.replace(ply)
            if seconds > (1 - CLOSE) * budget:
                break
            ahead = iterations * (budget / seconds) ** GROWTH
        iterations = round(max(ahead, fewest + 1))
        if most and iterations >= most:
            iterations = round((fewest * most) ** 0.5)
    if best is None:
        raise SystemExit(f"OpenSplat makes no {iterations} iterations of {folder} in {budget:g} s")
    options = schedule(variant, best[0])
    store.write_json(record, {"iterations": best[0], "seconds": best[1], "options": options})
    return Outcome(ply, *best)


def schedule(variant: Variant, iterations: int) -> dict[str, int]:
    """Options of a run's command line, each by its name.

    It grows in the multiples of refine-every that lie after densify-from and before densify-until.
    """
    share = min(iterations / WHOLE, 1.0)
    until = round(variant.growing * iterations)
    # As in its own schedule it first grows after two intervals, and one follows its last growth; in a short
    # run the four growths have to fit behind the step up to which it cannot grow.
    parts = math.ceil(until / (GROWTHS + 2))
    every = max(1, min(INTERVAL, parts, (until - 1 - NO_GROWTH) // GROWTHS))
    start = every * ((until - 1) // every - GROWTHS)
    return {
        "num-iters": iterations,
        "num-downscales": variant.downscales,
        "resolution-schedule": max(1, round(3000 * share)),
        "sh-degree-interval": max(1, round(1000 * share)),
        "densify-from": max(NO_GROWTH, min(INTERVAL, start)),
        "densify-until": until,
        "refine-every": every,
    }


def _iterated(
    program: Path, folder: Path, iterations: int, variant: Variant, ply: Path, most: float
) -> tuple[float, int]:
    """Processor seconds of one run from start to end, and the iterations that it came to: fewer than asked
    for where it would have taken more than `most` seconds and was killed.
    """
    words = [
        word for name, value in schedule(variant, iterations).items() for word in (f"--{name}", str(value))
    ]
    before = _children()
    command = [str(program), str(folder), "--cpu", "-o", str(ply), *words]
    limit = math.ceil(most)
    # Threads that wait by spinning would be charged for it wherever something else runs beside them.
    done = subprocess.run(
        ["prlimit", f"--cpu={limit}:{limit}", *command],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"OMP_WAIT_POLICY": "passive"},
    )
    seconds = _children() - before
    if done.returncode and seconds < 0.98 * limit:
        raise SystemExit(
            f"{' '.join(command)} ended with {done.returncode} after {seconds:.0f} s:\n"
            f"{done.stdout[-2000:]}{done.stderr[-2000:]}"
        )
    steps = re.findall(r"^Step (\d+):", done.stdout, re.MULTILINE)
    return seconds, int(steps[-1]) - 1 if done.returncode else iterations


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _run(command: list[str]) -> None:
    if shutil.which(command[0]) is None:
        raise SystemExit(f"{command[0]} is not installed: install it, or leave the peer out.")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
