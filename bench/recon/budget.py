"""Gain by time: quality of the demo against iterations and Gaussians, the curve behind the presets.

    python -m bench.recon.budget [--quick] [--json] [--write] [--seed 0] [--calibration own|truth] [--work
    FOLDER]
                           [--budgets 20s,40s,80s]

Each row is a whole training with its own schedule, not a point on the way of a longer one. Seconds are
wall-clock of the training loop on this machine, processor seconds all its threads together. With --budgets
the rows are whole commands instead, `rig reconstruct --budget`, each a process of its own, of the scenes of
bench/recon/presets.py in turn, at the preset `best` with more iterations than any of them has time for: how
long they took from Enter to the end, what they left out, and what was predicted of held-out quality. A row
that is done is kept, so a stopped script goes on.
"""

import argparse
import shutil
import subprocess
import sys
import time
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

from bench.recon.presets import SCENES, TOYS, Scene, folder_of
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache, prepare, run, session
from recon.decide.cost.budget import Budget
from recon.methods import nh_3dgs
from recon.result.model import read_model

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
        row = cache.get(f"{scene.name} {text}", partial(trained_within, options, scene, text))
        rows.append({"scene": scene.name} | row)
    return {"machine": machine(), "rows": rows}


def trained_within(options: argparse.Namespace, scene: Scene, text: str) -> dict[str, Any]:
    """One command within a time, in a process of its own."""
    folder, name = folder_of(scene, options.work), f"budget-{text}"
    began = time.monotonic()
    done = subprocess.run(
        [
            sys.executable, "-m", "rig", "reconstruct", str(folder), "--quality", "best", "--budget", text,
            "--set", f"iterations={ENDLESS}", "--name", name, "--json",
        ],
        capture_output=True, text=True, cwd=Path(__file__).parents[2], check=False,
    )  # fmt: skip
    row: dict[str, Any] = {"asked": Budget.parse(text).amount, "took": round(time.monotonic() - began, 2)}
    row["left_out"] = [line for line in done.stderr.splitlines() if "no room for" in line]
    if done.returncode:
        return row | {"refused": done.stderr.strip().splitlines()[-1]}
    record = read_model(folder / "reconstructions" / name)
    shutil.rmtree(folder / "reconstructions" / name)
    row |= {"iterations": record.iterations, "turns": len(record.schedule) - 2, "reached": record.held_out_db}
    return row | (record.predicted.model_dump() if record.predicted else {})


def report_budgets(result: dict[str, Any]) -> str:
    rows = result["rows"]
    judged = [row for row in rows if "db" in row]
    inside = sum(row["low"] <= row["reached"] <= row["high"] for row in judged)
    on_time = sum(row["took"] <= row["asked"] for row in rows)
    lines = [
        "# How well a budget of time is kept, and what is predicted of it",
        "",
        "`python -m bench.recon.budget --budgets ... --write`, `rig reconstruct --budget` from Enter "
        "to the end, "
        f"preset best without an end. {words(result['machine'])}. Done in time: {on_time} of "
        f"{len(rows)}; within the interval: {inside} of {len(judged)}, whose curves are of these scenes too: "
        "bench/results/learning_curves.md has scenes of other kinds.",
        "",
        "| scene | asked, s | took, s | share | iterations | turns | left out | predicted | interval | dB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        head = f"| {row['scene']} | {row['asked']:g} | {row['took']:.1f} | {row['took'] / row['asked']:.3f} "
        if "refused" in row:
            lines.append(f"{head}| {row['refused']} |  |  |  |  |  |")
            continue
        guess = f"{row['db']:.1f} | {row['low']:.1f} to {row['high']:.1f}" if "db" in row else "n/a | n/a"
        less = "; ".join(line.partition("no room for ")[2].rstrip(".") for line in row["left_out"])
        lines.append(
            f"{head}| {row['iterations']} | {row['turns']} | {less or 'nothing'} | {guess} "
            f"| {row['reached']:.1f} |"
        )
    return "\n".join(lines) + "\n"


def report(result: dict[str, Any]) -> str:
    lines = [
        "# What time buys",
        "",
        f"`python -m bench.recon.budget --write`: the demo rig, seed {result['seed']}, NH-3DGS, calibration: "
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
