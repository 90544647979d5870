"""Criteria by which a training splits Gaussians, and the effect of longer trainings.

    python -m bench.decided.splitting [--quick] [--json] [--write] [--seeds 2] [--long] [--work FOLDER]
        [--sets NAMES] [--code NAME]

Trains the code that is checked out, and compares it with whatever else has rows in FOLDER: run it in a work
tree of an older commit first, and name that. Starts, views and seeds are the same for all. Each
seed is another rig of the simulator; of the photographs of RIG_DATA it is another part of the views that is
held out, one in six (castle: one in five). --long trains four times as long as well.
"""

import argparse
import os
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.real.compare import session_of
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache, session
from imaging import metrics
from recon.data.dataset import Dataset
from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.data.truth import has_truth, true_radiance
from recon.decide.method_choice import method_for
from recon.decide.overrides import Overrides
from recon.methods import METHODS
from recon.start.initialisation import gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.learning_rates import rate_factor
from recon.train.ranks import Ranks
from recon.train.trainer import train
from recon.train.training import Plan, Training
from recon.train.warm_up import warm_up

LONGER = 4


@dataclass(frozen=True)
class Set:
    """Data set of a training. parts: of the views, one of which each seed holds out; 0: as the session has
    it.
    """

    name: str
    width: int
    iterations: int
    gaussians: int
    parts: int = 0

    def folder(self, work: Path, seed: int) -> Path:
        """Session folder, made now if it does not exist."""
        if self.name in ("castle", "monstree", "lego"):
            return session_of(self.name, work)
        return session(work, self.name, seed, "truth")


SIMULATED = (Set("demo", 320, 1000, 8000), Set("gallery", 320, 1000, 8000))
PHOTOGRAPHS = (
    Set("lego", 200, 1000, 10_000),
    Set("monstree", 250, 1000, 20_000, 6),
    Set("castle", 250, 1000, 20_000, 5),
)
TOYS = (Set("toy", 32, 60, 600),)


def held_out_by(dataset: Dataset, parts: int, seed: int) -> Dataset:
    """The same views, of which a part is held out."""
    if not parts:
        return dataset
    every = sorted((*dataset.train, *dataset.held_out), key=lambda view: view.name)
    out = [number % parts == seed % parts for number in range(len(every))]
    return replace(
        dataset,
        train=tuple(view for view, left in zip(every, out, strict=True) if not left),
        held_out=tuple(view for view, left in zip(every, out, strict=True) if left),
    )


def row(one: Set, iterations: int, seed: int, work: Path) -> dict[str, Any]:
    """Held-out PSNR of what was recorded, dB; and of the light, where the truth is known."""
    warm_up(lambda message, done, total: None)
    folder = one.folder(work, seed)
    dataset = held_out_by(load(folder, max_width=one.width), one.parts, seed)
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    points = start_points(
        dataset, images, one.gaussians // 2, np.random.Generator(np.random.PCG64([seed, 0x57A27]))
    )
    chosen, _ = method_for(dataset, "auto")
    method = Overrides(degree=1).composed(METHODS[chosen](dataset, light))
    start = gaussians_at(points, method.appearance, method.observation.units)
    training = Training.begin(method, light, start, dataset.extent)
    factor = rate_factor(iterations)
    plan = Plan(iterations, DensityRules(one.gaussians), seed, log_every=iterations, rate_factor=factor)
    began = time.process_time()
    train(training, dataset, plan, log=lambda line: None, save=lambda: None)
    used = time.process_time() - began
    found = {
        "db": training.held_out_psnr(dataset.held_out, 1.0, Ranks()),
        "trained_db": training.held_out_psnr(dataset.train[::4], 1.0, Ranks()),
        "gaussians": len(training.gaussians),
        "processor_seconds": round(used, 1),
    }
    return found | (against_light(training, dataset) if has_truth(folder) else {})


def against_light(training: Training, dataset: Dataset) -> dict[str, float]:
    """PSNR of mu-law light, dB, scaled to the truth, and the median error in stops; means over the views."""
    method = training.method
    with torch.no_grad():
        ours = [
            method.observation.radiance(
                training.renderer()(training.gaussians, view.lens, degree=method.degree(1.0)).image
            ).numpy()
            for view in dataset.held_out
        ]
    true = [true_radiance(dataset.session, view) for view in dataset.held_out]
    scale = metrics.align_scale(np.stack(ours), np.stack(true))
    peak = float(np.max(true))
    pairs = list(zip(ours, true, strict=True))
    return {
        "light_db": float(np.mean([metrics.hdr_psnr_mu(scale * a, b, peak) for a, b in pairs])),
        "stops": float(np.mean([metrics.stops_median(scale * a, b) for a, b in pairs])),
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, now, rows = Cache(options.work / "splitting.jsonl"), options.code, []
    for one in options.sets:
        lengths = (one.iterations, LONGER * one.iterations) if options.long else (one.iterations,)
        for iterations in lengths:
            for seed in range(1, 1 + options.seeds):
                name = f"{one.name} {iterations} {seed}"
                cache.get(f"{now} {name}", partial(row, one, iterations, seed, options.work))
    for key, found in cache.rows.items():
        code, name, length, number = key.split()
        rows.append(found | {"code": code, "set": name, "iterations": int(length), "seed": int(number)})
    return {"machine": machine(), "code": now, "rows": rows}


def report(result: dict[str, Any]) -> str:
    now, rows = result["code"], result["rows"]
    lines = [
        "# Which Gaussians are split",
        "",
        f"`python -m bench.decided.splitting --write`, {words(result['machine'])}. dB of held-out views, as "
        "recorded and, of simulated rigs, of the light (mu-law, aligned), and of a quarter of the training "
        "views. code: the commit or the statistic that was trained. Brackets: minus the line above, paired, "
        "+- standard error. The statistic was chosen on lego, monstree, the castle and the demo and gallery "
        "of another seed: on the photographs its gain is not held out from that choice.",
        "",
        "| set | iterations | code | n | recorded, dB | light, dB | stops | trained, dB | processor s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(one["set"] for one in rows):
        groups: dict[tuple[int, str], dict[int, Any]] = {}
        for one in rows:
            if one["set"] == name:
                groups.setdefault((one["iterations"], one["code"]), {})[one["seed"]] = one
        first: dict[int, Any] | None = None
        lines_of = sorted(groups.items(), key=lambda item: (item[0][0], item[0][1] == now))
        for (iterations, of), found in lines_of:
            cells = [_cell(found, first, key, digits) for key, digits in (
                ("db", 2), ("light_db", 2), ("stops", 4), ("trained_db", 2),
            )]  # fmt: skip
            seconds = np.mean([one["processor_seconds"] for one in found.values()])
            lines.append(
                f"| {name} | {iterations} | {of} | {len(found)} | {' | '.join(cells)} | {seconds:.0f} |"
            )
            first = found
    return "\n".join(lines) + "\n"


def _cell(found: dict[int, Any], before: dict[int, Any] | None, key: str, digits: int) -> str:
    """A mean over the seeds; and the change from what is in the line before, over seeds that both have."""
    if any(key not in one for one in found.values()):
        return "-"
    cell = f"{np.mean([one[key] for one in found.values()]):.{digits}f}"
    before = before or {}
    shared = [found[seed][key] - before[seed][key] for seed in found if seed in before]
    if len(shared) < 2:
        return cell if not shared else f"{cell} ({shared[0]:+.{digits}f})"
    error = np.std(shared, ddof=1) / np.sqrt(len(shared))
    return f"{cell} ({np.mean(shared):+.{digits}f} +- {error:.{digits}f})"


def main() -> None:
    parser = arguments(__doc__, seeds=2)
    parser.add_argument("--code", default="now", help="what rows of this code are called, one word")
    parser.add_argument("--long", action="store_true", help="four times the iterations as well")
    parser.add_argument("--sets", help="names, joined by commas")
    options = parser.parse_args()
    every = (*SIMULATED, *(PHOTOGRAPHS if os.environ.get("RIG_DATA") else ()))
    names = options.sets.split(",") if options.sets else [one.name for one in every]
    options.sets = [one for one in every if one.name in names]
    if options.quick:
        options.sets, options.seeds, options.work = TOYS, 1, options.work / "quick"
    result = measure(options)
    deliver(options, "splitting", result, report(result))


if __name__ == "__main__":
    main()
