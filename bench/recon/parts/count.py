"""Number of Gaussians: needed by scenes, chosen by the ladder, and the cost of its trials.

    python -m bench.recon.parts.count [--quick] [--json] [--write] [--seeds 2] [--iterations 2000]
        [--work FOLDER]

Simulated sessions with their true calibration, at several widths, trained as `rig reconstruct` trains
`standard`: once with each of several numbers of Gaussians, all harmonics on, and once as the ladder has it.
needed: the smallest number that lies within 0.2 dB of the best of the sweep, on straight lines over the
logarithm of the number. Finished rows are kept in FOLDER. --quick takes a toy session and short trainings.
"""

import argparse
import shutil
import time
from functools import partial
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any
from unittest import mock

from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache, session
from recon.decide import decisions
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.decide.steps import size
from recon.decide.steps.size import COLOUR, COUNT
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.train.devices.warm_up import warm_up

CAP = QUALITIES["standard"].gaussians
COUNTS = (1250, 2500, 5000, 10_000, 20_000, 40_000)
TOY_COUNTS = (400, 800, 1600, 3200, 6400, 20_000)
SCENES = (("toy", 64), ("demo", 160), ("gallery", 160), ("demo", 320), ("gallery", 320))
WITHIN = 0.2
"""dB of the best of a sweep that count as the best."""
RATIO = 1.3
"""Largest ratio of the chosen number to the needed one."""
MEASURES = {"truth": "hdr_psnr_mu_aligned", "pictures": "raw_psnr"}


def train(folder: Path, quality: Quality, seed: int, overrides: Overrides) -> dict[str, Any]:
    """One training: metrics, seconds of the processor in all and of the trials, and what was decided."""
    spent: list[float] = []
    decide = size.gaussians_for

    def timed(*arguments: Any) -> Any:
        began = time.process_time()
        chosen = decide(*arguments)
        spent.append(time.process_time() - began)
        return chosen

    warm_up(lambda message, done, total: None)
    with mock.patch.dict(QUALITIES, standard=quality), mock.patch.object(decisions, "gaussians_for", timed):
        began = time.process_time()
        made = reconstruct(folder, TrainingRequest(seed=seed, overrides=overrides, name="count"))
        used = time.process_time() - began
    metrics, model = evaluate(made).known(), read_model(made)
    shutil.rmtree(made)  # a finished training would be taken for the next one of the same settings
    rungs = {rung.name: rung for rung in model.rungs}
    return {
        "gaussians": metrics["gaussians"],
        "degree": model.settings.degree,
        "processor_seconds": round(used, 2),
        "trial_seconds": round(sum(spent), 2),
        "why": [rungs[name].reason for name in (COUNT, COLOUR)],
        **{name: metrics[key] for name, key in MEASURES.items()},
    }


def needed(rows: list[dict[str, Any]], measure: str) -> float:
    """The smallest number within 0.2 dB of the best, between those that were trained."""
    line = max(row[measure] for row in rows) - WITHIN
    if rows[0][measure] >= line:
        return float(rows[0]["gaussians"])
    for low, high in pairwise(rows):
        if high[measure] >= line:
            share = (line - low[measure]) / (high[measure] - low[measure])
            return float(low["gaussians"] * (high["gaussians"] / low["gaussians"]) ** share)
    raise AssertionError("the best is among them")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    rows: list[dict[str, Any]] = []
    cache = Cache(options.work / f"count-{options.iterations}.jsonl")

    def row(key: str, folder: Path, quality: Quality, seed: int, overrides: Overrides) -> dict[str, Any]:
        figures: dict[str, Any] = cache.get(key, partial(train, folder, quality, seed, overrides))
        return figures

    for name, width in options.scenes:
        for seed in range(options.seeds):
            folder = session(options.work, name, seed, "truth")
            quality = Quality(options.iterations, CAP, width)
            key, plain = f"{name} {width} {seed}", Overrides(refine="none")
            chosen = row(f"{key} chosen", folder, quality, seed, plain)
            counts = TOY_COUNTS if name.startswith("toy") else COUNTS
            many = [
                row(f"{key} {n}", folder, quality, seed, Overrides(refine="none", gaussians=n))
                for n in counts[: options.most]
            ]
            rows.append({"scene": name, "width": width, "seed": seed, "chosen": chosen, "sweep": many})
            for of in MEASURES:
                best = max(many, key=itemgetter(of))
                rows[-1][of] = {
                    "best": best[of],
                    "best_gaussians": best["gaussians"],
                    "needed": needed(many, of),
                    "short": best[of] - chosen[of],
                    "ratio": chosen["gaussians"] / needed(many, of),
                }
    return {"machine": machine(), "iterations": options.iterations, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# How many Gaussians scenes need",
        "",
        f"`python -m bench.recon.parts.count --write`: NH-3DGS on RAW brackets, true calibration, "
        f"{result['iterations']} iterations, at most {CAP:,} Gaussians. {words(result['machine'])}.",
        "",
        "To the truth (hdr_psnr_mu_aligned) / on held-out pictures (raw_psnr). needed: the smallest number "
        f"within {WITHIN:g} dB of the best of the sweep; short: dB that the chosen one lies below the best "
        f"(at most {WITHIN:g}); ratio: chosen to needed (at most {RATIO:g}); trials: their share of the "
        "processor time of what follows them.",
        "",
        "| scene | px | seed | best, dB | with | needed | chosen | degree | short, dB | ratio | trials |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in result["rows"]:
        both, chosen = [one[name] for name in MEASURES], one["chosen"]

        def cell(key: str, form: str, both: list[dict[str, float]] = both) -> str:
            return " / ".join(format(side[key], form) for side in both)

        after = chosen["processor_seconds"] - chosen["trial_seconds"]
        lines.append(
            f"| {one['scene']} | {one['width']} | {one['seed']} | {cell('best', '.2f')} "
            f"| {cell('best_gaussians', ',.0f')} | {cell('needed', ',.0f')} | {chosen['gaussians']:,} "
            f"| {chosen['degree']} | {cell('short', '+.2f')} | {cell('ratio', '.2f')} "
            f"| {100 * chosen['trial_seconds'] / after:.0f} % |"
        )
    cases = [one[name] for one in result["rows"] for name in MEASURES]
    good = sum(case["short"] <= WITHIN and case["ratio"] <= RATIO for case in cases)
    lines += ["", f"Both limits hold in {good} of {len(cases)} cases.", "", "Sweeps, dB to the truth:", ""]
    for one in result["rows"]:
        curve = ", ".join(f"{row['truth']:.2f} with {row['gaussians']:,}" for row in one["sweep"])
        lines.append(f"* {one['scene']}, {one['width']} px, seed {one['seed']}: {curve}.")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--iterations", type=int, default=2000)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.scenes, options.most = SCENES, len(COUNTS)
    if options.quick:
        options.scenes, options.most, options.seeds, options.iterations = SCENES[:1], 3, 1, 60
    result = measure(options)
    deliver(options, "count", result, report(result))


if __name__ == "__main__":
    main()
