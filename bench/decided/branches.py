"""Prediction of a long training from a short one: on the way, after a brief cooling down, or not at all.

    python -m bench.decided.branches [--quick] [--json] [--write] [--seed 0] [--work FOLDER]

A sweep could be cheaper if one long training served for the shorter ones too. Three rows for each length:
`planned`, a training whose schedule is that long; `on the way`, the longest training as it is at that
iteration; `cooled`, a copy of it trained on for a tenth of its iterations, in which the learning rates fall
to their ends and all harmonics are on. The demo rig, calibrated by its own pictures.
"""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache, Trial, prepare, quality, session
from recon.methods import nh_3dgs
from recon.scene.appearance import Rate
from recon.start.initialisation import gaussians_at
from recon.train.densification import DensityRules
from recon.train.resume import checkpoint_of, restored
from recon.train.trainer import train
from recon.train.training import Plan, Training
from recon.train.warm_up import warm_up

MEASURES = ("raw_psnr", "hdr_psnr_mu_aligned", "hdr_psnr_mu_dark")
COOLING = 0.1


def begun(trial: Trial) -> Training:
    method = nh_3dgs.compose(trial.dataset, trial.light)
    gaussians = gaussians_at(trial.start, method.appearance, method.observation.units)
    return Training.begin(method, trial.light, gaussians, trial.dataset.extent)


def trained(training: Training, trial: Trial, total: int, seed: int, until: int | None = None) -> None:
    plan = Plan(total, DensityRules(trial.cap), seed, log_every=total)
    train(training, trial.dataset, plan, log=lambda line: None, save=lambda: None, until=until)


def cooled(training: Training, trial: Trial, total: int, seed: int) -> Training:
    """A copy, trained on for a tenth, the learning rates falling from where they are to where they end."""
    checkpoint = checkpoint_of(training, {})
    tensors = {name: value.detach().clone() for name, value in checkpoint.tensors.items()}
    method = nh_3dgs.compose(trial.dataset, trial.light)
    copy = restored(method, replace(checkpoint, tensors=tensors), trial.dataset.extent)
    length = round((1 + COOLING) * training.iteration)
    done = training.iteration / length
    for group in copy.optimizer.param_groups:
        now, end = group["rate"].at(training.iteration / total), group["rate"].end
        # The exponential through `now` at this moment and `end` at the end.
        group["rate"] = Rate(float((now / end) ** (1 / (1 - done)) * end), end)
    trained(copy, trial, length, seed)
    return copy


def row(trial: Trial, training: Training, kind: str, length: int) -> dict[str, Any]:
    found = quality(trial, training)
    own = {"kind": kind, "length": length, "iterations": training.iteration}
    return own | {"gaussians": len(training.gaussians)} | {key: found[key] for key in MEASURES}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    torch.set_num_threads(1)
    cache = Cache(options.work / f"branches-{options.sim}-{options.cap}-{options.seed}.jsonl")
    *lengths, longest = options.lengths
    loaded: list[Trial] = []

    def trial() -> Trial:
        if not loaded:
            warm_up(lambda message, done, total: None)
            folder = session(options.work, options.sim, options.seed, options.calibration)
            loaded.append(prepare(folder, options.cap, options.seed))
        return loaded[0]

    def planned(length: int) -> dict[str, Any]:
        training = begun(trial())
        trained(training, trial(), length, options.seed)
        return row(trial(), training, "planned", length)

    def along() -> list[dict[str, Any]]:
        training, rows = begun(trial()), []
        for length in lengths:
            trained(training, trial(), longest, options.seed, until=length)
            rows.append(row(trial(), training, "on the way", length))
            rows.append(row(trial(), cooled(training, trial(), longest, options.seed), "cooled", length))
        return rows

    rows = cache.get(f"along {options.lengths}", along)
    rows = [cache.get(f"planned {n}", partial(planned, n)) for n in options.lengths] + rows
    result = {"machine": machine(), "seed": options.seed, "sim": options.sim, "longest": longest}
    return result | {"cap": options.cap, "rows": sorted(rows, key=lambda one: one["length"])}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# What a long training shows of a short one",
        "",
        f"`python -m bench.decided.branches --write`: the {result['sim']} rig, seed {result['seed']}, "
        "NH-3DGS, at "
        f"most {result['cap']} Gaussians; the longest training has {result['longest']} iterations. "
        f"{words(result['machine'])}.",
        "",
        "| length | how | iterations | Gaussians | RAW dB | dB | dB, dark |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in result["rows"]:
        figures = " | ".join(f"{one[key]:.2f}" for key in MEASURES)
        head = f"| {one['length']} | {one['kind']} | {one['iterations']} | {one['gaussians']} "
        lines.append(f"{head}| {figures} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.sim, options.calibration, options.cap = "demo", "own", 10_000
    options.lengths = [125, 250, 500, 1000]
    if options.quick:
        options.sim, options.calibration, options.cap = "toy", "truth", 900
        options.lengths = [25, 50, 100, 200]
    result = measure(options)
    deliver(options, "branches", result, report(result))


if __name__ == "__main__":
    main()
