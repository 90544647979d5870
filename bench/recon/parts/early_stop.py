"""Early stopping, its cost and its saving: standard and best as they are, and ended where little is
gained.

    python -m bench.recon.parts.early_stop [--quick] [--json] [--write] [--work FOLDER]

The scenes of bench/recon/presets.py, whose trainings in full are taken from its sweeps where they are there.
dB as `rig evaluate` measures them, of the test views, by which nothing was ended; seconds of the training.
Finished rows are kept in FOLDER.
"""

import argparse
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import fmean, median
from typing import Any, get_args

import numpy as np

from bench.recon.presets import SCENES, TINY, TOYS, Scene, folder_of
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from recon.decide.presets import QUALITIES, MethodName
from recon.decide.request import TrainingRequest
from recon.measure.view_figures import measured
from recon.reconstruct import reconstruct
from recon.result.opened import open_model
from recon.trade.point import measuring, quality_of, train_point
from recon.trade.sweep import trade_sweep
from recon.trade.trade_record import FOLDER, TRADE, Choice, Trade, code_hash, read_trade

METHODS: dict[str, MethodName] = {name: name for name in get_args(MethodName)}
PRESETS = ("standard", "best")
LOSS, SHARE = 0.1, 0.5
"""dB that stopping may cost in the mean, and the median share of the iterations that it should take."""


def recorded(session: Path) -> Trade:
    """The session's sweep as far as it goes; one of other code, or none, begins anew with one training."""
    earlier = read_trade(session) if (session / FOLDER / TRADE).exists() else None
    return (
        earlier if earlier is not None and earlier.code == code_hash() else trade_sweep(session, budget=0.0)
    )


def compared(scene: Scene, quality: Any, options: argparse.Namespace) -> dict[str, Any]:
    """A scene trained by a preset in full, and with early stop."""
    session = folder_of(scene, options.work)
    trade = recorded(session)
    choice = Choice(axis="preset", quality=quality)
    swept = [p for p in trade.points if p.choice.quality == quality and not p.choice.overrides.words()]
    full = swept[0] if swept else train_point(session, choice, trade)
    made = reconstruct(
        session,
        TrainingRequest(
            method=METHODS[trade.method], quality=quality, seed=trade.seed, name="early", early_stop=True
        ),
        shelf=FOLDER,
    )
    opened = open_model(made)
    # On the views that the training was not ended by, both.
    dataset = replace(measuring(session, trade.width), watched=opened.dataset.watched)
    _, _, rows, _ = measured(replace(opened, dataset=dataset))
    by_view = quality_of(rows)
    db = float(np.mean(list(by_view.values())))
    full_db = float(np.mean([full.views[view] for view in by_view]))
    figures = {
        "full_db": full_db, "full_seconds": full.seconds, "full_iterations": full.iterations,
        "db": db, "seconds": opened.record.train_seconds, "iterations": opened.training.iteration,
    }  # fmt: skip
    shutil.rmtree(made)
    return figures


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "early_stop.jsonl")
    rows = [
        {"scene": scene.name, "preset": quality}
        | cache.get(f"{scene.name} {quality}", partial(compared, scene, quality, options))
        for scene in options.scenes
        for quality in PRESETS
    ]
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# What stopping early costs and saves",
        "",
        f"`python -m bench.recon.parts.early_stop --write`. {words(result['machine'])}. Held-out pictures "
        "as `rig evaluate` measures them. Share: of the iterations, since seconds of another hour do not "
        "compare.",
        "",
        "| scene | preset | full, dB | s | iterations | stopped, dB | s | iterations | lost | share |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        lines.append(
            f"| {row['scene']} | {row['preset']} | {row['full_db']:.2f} | {row['full_seconds']:.0f} "
            f"| {row['full_iterations']} | {row['db']:.2f} | {row['seconds']:.0f} | {row['iterations']} "
            f"| {row['full_db'] - row['db']:.2f} | {row['iterations'] / row['full_iterations']:.2f} |"
        )
    lines.append("")
    for quality in PRESETS:
        of_preset = [row for row in result["rows"] if row["preset"] == quality]
        lost = [row["full_db"] - row["db"] for row in of_preset]
        shares = [row["iterations"] / row["full_iterations"] for row in of_preset]
        lines.append(
            f"{quality}: {fmean(lost):.2f} dB lost in the mean (asked: {LOSS}), {max(lost):.2f} at most; "
            f"{median(shares):.2f} of the iterations in the median (asked: {SHARE})."
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.scenes = SCENES
    if options.quick:
        QUALITIES.update(TINY)
        options.scenes, options.work = TOYS, options.work / "quick"
    result = measure(options)
    deliver(options, "early_stop", result, report(result))


if __name__ == "__main__":
    main()
