"""Trainings whose first half looks at views of half their size, beside whole ones of the same iterations.

    python -m bench.speed.half_size [--sets castle,banana,fox,lego,demo] [--quick] [--json] [--write]
        [--seeds 3] [--work FOLDER]

Processor seconds of the training alone, on one thread, both ways from the same points; quality of the
held-out views of a session. demo is the simulator's, of RAW at twice its size, calibrated from the truth.
"""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from statistics import fmean
from typing import Any, Self
from unittest.mock import patch

import numpy as np

from bench.peers.compare import session_of
from bench.support.oracle import oracle_session
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from drivers.sim.rig_settings import RIGS
from imaging.compute import threads
from recon.data.dataset import Dataset
from recon.data.light import Light, light_of, radiance_images
from recon.data.load import load
from recon.data.resident import pixels_of
from recon.decide.presets import START_SHARE
from recon.decide.steps.method_choice import method_for
from recon.methods import METHODS
from recon.start.initialisation import Start, gaussians_at, start_points
from recon.train import half_size
from recon.train.densification import DensityRules
from recon.train.devices.ranks import Ranks
from recon.train.devices.warm_up import warm_up
from recon.train.schedule import rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training


@dataclass(frozen=True)
class Case:
    """Width, px, Gaussians and iterations at which a set is trained, and seeds at most."""

    width: int
    gaussians: int
    iterations: int
    seeds: int = 1


CASES = {
    "castle": Case(1280, 60_000, 200, seeds=3),
    "banana": Case(1280, 80_000, 150, seeds=3),
    "fox": Case(640, 40_000, 400),
    "lego": Case(400, 40_000, 500, seeds=3),
    "demo": Case(640, 40_000, 400),
}
WAYS = {"whole": math.inf, "halved": 0.0}
"""Pixels for each Gaussian from which on the first half is halved."""


def _session(name: str, work: Path) -> Path:
    if name != "demo":
        return session_of(name, work)
    large = "demo-640"
    RIGS[large] = replace(RIGS["demo"], width=640, height=480)
    return oracle_session(work / large, large)


@dataclass(frozen=True)
class Prepared:
    """A set, read, with its light and the points that both ways start from."""

    dataset: Dataset
    light: Light
    start: Start

    @classmethod
    def of(cls, session: Path, case: Case, seed: int) -> Self:
        """Read a session and find its points."""
        warm_up(lambda message, done, total: None)
        dataset = load(session, max_width=case.width)
        images = radiance_images(dataset)
        rng = np.random.Generator(np.random.PCG64([seed, 0x57A27]))
        start = start_points(dataset, images, int(START_SHARE * case.gaussians), rng)
        return cls(dataset, light_of(dataset, images), start)


def trained(prepare: Callable[[], Prepared], case: Case, seed: int, way: str) -> dict[str, Any]:
    """Row of one training."""
    prepared = prepare()
    dataset = prepared.dataset
    method = METHODS[method_for(dataset, "auto")[0]](dataset, prepared.light)
    gaussians = gaussians_at(prepared.start, method.appearance, method.observation.units)
    training = Training.begin(method, prepared.light, gaussians, dataset.extent)
    plan = Plan(
        case.iterations,
        DensityRules(case.gaussians),
        seed,
        log_every=case.iterations,
        rate_factor=rate_factor(case.iterations),
    )
    began = time.process_time()
    with patch.multiple(half_size, PIXELS=WAYS[way], FEWEST=0):
        train(training, dataset, plan)
    spent = time.process_time() - began
    pixels = fmean(map(pixels_of, dataset.train))
    quality = training.held_out_psnr(dataset.held_out, 1.0, Ranks())
    return {"seconds": spent, "db": quality, "views": len(dataset.train), "pixels": pixels / case.gaussians}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    finished, rows = Cache(options.work / "half_size.jsonl"), []
    for name in options.sets.split(","):
        case = replace(CASES[name], iterations=20) if options.quick else CASES[name]
        for seed in range(1 if options.quick else min(options.seeds, case.seeds)):
            prepare = cache(partial(Prepared.of, _session(name, options.work), case, seed))
            for way in WAYS:
                key = f"{name} {case.width} {case.gaussians} {case.iterations} {seed} {way}"
                row = finished.get(key, partial(trained, prepare, case, seed, way))
                rows.append(vars(case) | {"set": name, "way": way, "seed": seed} | row)
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Half the size for the first half of a training",
        "",
        "`python -m bench.speed.half_size --write`: the same iterations from the same points, mean over "
        "seeds; processor seconds of the training alone on one thread, dB of held-out views, and by how much "
        f"halving changes them with each seed. {words(result['machine'])}.",
        "",
        "| set | views | width, px | Gaussians | pixels a Gaussian | iterations | whole, s | halved, s "
        "| ratio | whole, dB | halved, dB | gain, dB | of each seed |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    rows = result["rows"]
    for name in dict.fromkeys(row["set"] for row in rows):
        whole, half = ([row for row in rows if row["set"] == name and row["way"] == way] for way in WAYS)
        seconds, db = ([fmean(row[key] for row in way) for way in (whole, half)] for key in ("seconds", "db"))
        gains = [b["db"] - a["db"] for a, b in zip(whole, half, strict=True)]
        one = whole[0]
        lines.append(
            f"| {name} | {one['views']} | {one['width']} | {one['gaussians']:,} | {one['pixels']:.1f} "
            f"| {one['iterations']} | {seconds[0]:.0f} | {seconds[1]:.0f} | {seconds[1] / seconds[0]:.2f} "
            f"| {db[0]:.2f} | {db[1]:.2f} | {fmean(gains):+.2f} "
            f"| {', '.join(f'{gain:+.2f}' for gain in gains)} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=3)
    parser.add_argument("--sets", default=",".join(CASES))
    options = parser.parse_args()
    threads.set_threads(1)
    result = measure(options)
    deliver(options, "half_size", result, report(result))


if __name__ == "__main__":
    main()
