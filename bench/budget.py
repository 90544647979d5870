"""What time buys: quality of the demo against iterations and Gaussians, the curve behind the presets.

    python bench/budget.py [--quick] [--json] [--write] [--seed 0] [--calibration own|truth] [--work FOLDER]
                           [--budgets 20s,40s,80s]

Each row is a whole training with its own schedule, not a point on the way of a longer one. Seconds are
wall-clock of the training loop on this machine, processor seconds all its threads together. With --budgets
the rows are reconstructions within these times instead, of the scenes of bench/presets.py in turn, at the
preset `best` with more iterations than any of them has time for: how well the time was kept, and what was
foretold of held-out quality. A row that is done is kept, so a stopped script goes on.
"""

import argparse
import shutil
import time
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

from presets import SCENES, TOYS, Scene, folder_of
from record import WORK, arguments, deliver, machine, words
from trial import Cache, prepare, run, session

from recon.budget import Budget
from recon.fixed import Fixed
from recon.methods import nh_3dgs
from recon.model import read_model
from recon.reconstruct import reconstruct

GRID = [(250, 10_000), (500, 10_000), (500, 20_000), (1000, 20_000), (2000, 20_000), (4000, 20_000)]
GRID += [(1000, 40_000), (2000, 40_000), (4000, 40_000)]
ENDLESS = 100_000
"""Iterations that no budget has time for."""
COLUMNS = ("iterations", "gaussians", "seconds", "processor_seconds")
MEASURES = ("hdr_psnr_mu_aligned", "hdr_psnr_mu_dark", "stops_median", "raw_psnr")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"budget-{options.calibration}-{options.sim}-{options.seed}.jsonl")
    rows = []
    for iterations, cap in options.grid:

        def train(iterations: int = iterations, cap: int = cap) -> Any:
            folder = session(options.work, options.sim, options.seed, options.calibration)
            return run(prepare(folder, cap, options.seed), nh_3dgs.compose, iterations, options.seed)[-1]

        rows.append(cache.get(f"{iterations} {cap}", train))
    return {
        "machine": machine(),
        "calibration": options.calibration,
        "seed": options.seed,
        "rows": rows,
    }


def measure_budgets(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "budgets.jsonl")
    rows = []
    for text, scene in zip(options.budgets, cycle(options.scenes), strict=False):
        row = cache.get(f"{scene.name} {text}", partial(kept, options, scene, text))
        rows.append({"scene": scene.name} | row)
    return {"machine": machine(), "rows": rows}


def kept(options: argparse.Namespace, scene: Scene, text: str) -> dict[str, Any]:
    """One reconstruction within a time."""
    folder = folder_of(scene, options.work)
    began = time.monotonic()
    made = reconstruct(
        folder, quality="best", fixed=Fixed(iterations=ENDLESS), budget=text, name=f"budget-{text}"
    )
    record = read_model(made)
    shutil.rmtree(made)
    asked, used = Budget.parse(text).amount, record.train_seconds + record.measuring_seconds
    row: dict[str, Any] = {"asked": asked, "used": used, "whole": round(time.monotonic() - began, 2)}
    row |= {"iterations": record.iterations, "turns": len(record.course) - 2, "reached": record.held_out_db}
    return row | (record.predicted.model_dump() if record.predicted else {})


def report_budgets(result: dict[str, Any]) -> str:
    rows = result["rows"]
    told = [row for row in rows if "db" in row]
    inside = sum(row["low"] <= row["reached"] <= row["high"] for row in told)
    on_time = sum(0.95 * row["asked"] <= row["used"] <= 1.05 * row["asked"] for row in rows)
    lines = [
        "# How well a budget of time is kept, and what is foretold of it",
        "",
        f"`python bench/budget.py --budgets ... --write`, "
        f"preset best without an end. {words(result['machine'])}. Within 5 % of the time: {on_time} of "
        f"{len(rows)}; within the interval: {inside} of {len(told)}. Whole: all of it.",
        "",
        "| scene | asked, s | used, s | share | whole, s | iterations | turns | foretold | interval | dB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        guess = f"{row['db']:.1f} | {row['low']:.1f} to {row['high']:.1f}" if "db" in row else "n/a | n/a"
        lines.append(
            f"| {row['scene']} | {row['asked']:g} | {row['used']:.1f} | {row['used'] / row['asked']:.3f} "
            f"| {row['whole']:.1f} | {row['iterations']} | {row['turns']} | {guess} | {row['reached']:.1f} |"
        )
    return "\n".join(lines) + "\n"


def report(result: dict[str, Any]) -> str:
    lines = [
        "# What time buys",
        "",
        f"`python bench/budget.py --write`: the demo rig, seed {result['seed']}, NH-3DGS, calibration: "
        f"{result['calibration']}. {words(result['machine'])}.",
        "",
        "| iterations | Gaussians | s | processor s | dB | dB, dark | stops | RAW dB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        cells = [f"{row[key]:.0f}" for key in COLUMNS]
        cells += [f"{row[key]:.{3 if key == 'stops_median' else 2}f}" for key in MEASURES]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--calibration", choices=("own", "truth"), default="own")
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--budgets", type=lambda text: text.split(","))
    options = parser.parse_args()
    options.sim, options.grid = "demo", GRID
    if options.quick:
        options.sim, options.calibration = "toy", "truth"
        options.grid = [(50, 600), (100, 600), (200, 600), (200, 1200)]
    options.scenes = TOYS if options.quick else SCENES
    if options.budgets:
        result = measure_budgets(options)
        deliver(options, "budgets", result, report_budgets(result))
        return
    result = measure(options)
    deliver(options, "budget", result, report(result))


if __name__ == "__main__":
    main()
