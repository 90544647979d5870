"""Value of depth measured beside the photographs: at the start, and as a term of the loss.

    python -m bench.decided.depth [--quick] [--json] [--write] [--work FOLDER]

Simulated rigs of 24 views with their true calibration, of which a third is held out and some of the others
train. Their true depth has 1 % of noise and holes over a fifth of the picture. Finished rows are kept in
FOLDER.
"""

import argparse
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.depths import add_depths
from bench.support.oracle import oracle_session
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.files import store
from imaging.session.records import SplitRecord
from imaging.session.session import SPLIT, Session
from recon.decide.overrides import Overrides
from recon.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.scene import open_model

NOTHING = 1e-9
"""A weight at which only the start knows of the depth."""
VARIANTS = {"none": 0.0, "start": NOTHING, "0.1": 0.1, "0.5": 0.5, "2": 2.0}
CASES = [
    (rig, 0, *length, 0.01) for rig in ("demo", "gallery") for length in ((6, 300), (12, 400), (16, 500))
]
"""Rig, seed, training views, iterations, noise."""
HOLES = 0.2
WIDTH, GAUSSIANS = 160, 6_000


def session(work: Path, rig: str, seed: int, noise: float) -> Path:
    """A session with depth maps, every third view held out."""
    folder = work / f"{rig}-{seed}-{noise:g}"
    if not (folder / SPLIT).exists():
        oracle_session(folder, rig, seed=seed)
        add_depths(folder, noise, HOLES, seed)
        shots = Session.open(folder).shots("scene")
        views = sorted({shot.view for shot in shots})
        tested = set(views[1::3])
        split = SplitRecord(
            reason="every third view",
            train=tuple(shot.file for shot in shots if shot.view not in tested),
            test=tuple(shot.file for shot in shots if shot.view in tested),
        )
        store.write_json(folder / SPLIT, split.model_dump(mode="json"))
    return folder


def train(work: Path, rig: str, seed: int, views: int, iterations: int, noise: float, weight: float) -> Any:
    """Held-out dB of the light, error in stops, and how the maps fit."""
    made = reconstruct(
        session(work, rig, seed, noise),
        method="nh-3dgs",
        seed=seed,
        overrides=Overrides(
            iterations=iterations, gaussians=GAUSSIANS, width=WIDTH, views=views, refine="none", degree=0,
            environment=False, depth=weight,
        ),
        name=f"{views}-{weight:g}",
        replace=True,
    )  # fmt: skip
    metrics, model = evaluate(made).known(), open_model(made)
    reason = next((rung.reason for rung in model.record.rungs if rung.name == "depth start"), "")
    shutil.rmtree(made)
    return {"db": metrics["hdr_psnr_mu_aligned"], "stops": metrics["stops_median"], "reason": reason}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, rows = Cache(options.work / "depth.jsonl"), []
    for case in options.cases:
        own = {}
        rig, seed, views, iterations, noise = case
        for name, weight in VARIANTS.items():
            key = " ".join(map(str, (*case, name)))
            make = partial(train, options.work, rig, seed, views, iterations, noise, weight)
            own[name] = cache.get(key, make)
        names = ("rig", "seed", "views", "iterations", "noise")
        rows.append({**dict(zip(names, case, strict=True)), "variants": own})
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Measured depth",
        "",
        f"`python -m bench.decided.depth --write`, {words(result['machine'])}. NH-3DGS on RAW brackets of "
        f"the simulator, {WIDTH} px wide, {GAUSSIANS:,} Gaussians, eight of 24 views held out; true depth "
        f"with noise and {100 * HOLES:g} % of holes, in millimetres. Held-out light, dB: without depth, then "
        "what is gained where the start takes it in place of a plane sweep, and where the loss compares with "
        "it, too, at each weight.",
        "",
        "| scene | seed | views | iterations | noise | without | start | 0.1 | 0.5 | 2 |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        own = {name: one["db"] for name, one in row["variants"].items()}
        gains = " | ".join(f"{own[name] - own['none']:+.2f}" for name in list(VARIANTS)[1:])
        lines.append(
            f"| {row['rig']} | {row['seed']} | {row['views']} | {row['iterations']} "
            f"| {100 * row['noise']:g} % | {own['none']:.2f} | {gains} |"
        )
    for views in sorted({row["views"] for row in result["rows"]}):
        rows = [row for row in result["rows"] if row["views"] == views and row["noise"] == 0.01]
        means = {
            name: np.mean([row["variants"][name]["db"] - row["variants"]["none"]["db"] for row in rows])
            for name in list(VARIANTS)[1:]
        }
        differences = ", ".join(f"{name} {mean:+.2f}" for name, mean in means.items())
        lines += ["", f"Mean of {len(rows)} with {views} views and 1 % of noise: {differences} dB."]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK / "depth")
    options = parser.parse_args()
    options.cases = CASES
    if options.quick:
        options.cases = [("toy", 0, 4, 40, 0.01)]
        options.work = options.work / "quick"
    result = measure(options)
    deliver(options, "depth", result, report(result))


if __name__ == "__main__":
    main()
