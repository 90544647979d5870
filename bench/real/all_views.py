"""Training on every photograph of a small set, beside training on those that are not held out.

    python -m bench.real.all_views [--quick] [--json] [--write] [--seeds 1] [--work FOLDER] [--sets ...]

One photograph in four of each set, in turn, is held out by this script and judges two drafts: one trained on
all others, as by `rig reconstruct --all-views`, and one that holds out one in eight of these, as is usual.
Each has the width of `bench.real.more_time`. Finished rows are kept in FOLDER. --quick: the castle.
"""

import argparse
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.peers.compare import session_of
from bench.real.more_time import FOLDS, SETS, WIDTH, fold_of, trained
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.arrays import Array
from imaging.session.records import SplitRecord
from imaging.session.session import SPLIT, Session
from recon.data.holdout import held_out

KINDS = ("all", "seven in eight")


def split_of(session: Path, fold: int, kind: str, work: Path) -> None:
    """Let the session of a fold train on all others than its held-out views, or on seven in eight of them."""
    folder = fold_of(session, fold, work)
    shots = {shot.file: shot for shot in Session.open(session).shots("scene")}
    tested = tuple(sorted(shots)[fold::FOLDS])
    others = [shots[file] for file in sorted(shots) if file not in tested]
    out = held_out(shot.view for shot in others) if kind != KINDS[0] else set()
    train = tuple(shot.file for shot in others if shot.view not in out)
    split = SplitRecord(reason=f"fold {fold} of {FOLDS}, {kind}", train=train, test=tested)
    (folder / SPLIT).write_text(split.model_dump_json())


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set, kind, fold and seed."""
    cache, rows = Cache(options.work / "real-all-views.jsonl"), []
    sets = SETS[:1] if options.quick else options.sets
    for name, fold, kind, seed in product(sets, range(FOLDS), KINDS, range(options.seeds)):

        def made(name: str = name, fold: int = fold, kind: str = kind, seed: int = seed) -> dict[str, Any]:
            session = session_of(name, options.work)
            split_of(session, fold, kind, options.work)
            return trained(session, fold, options.work, "draft", seed)

        what = {"set": name, "kind": kind, "fold": fold, "seed": seed}
        rows.append(what | cache.get(f"{name} {kind} fold {fold} seed {seed}", made))
    return {"machine": machine(), "rows": rows}


def by_view(result: dict[str, Any], name: str, kind: str) -> Array:
    """Held-out dB and SSIM of every view of a set, [views, 2], means over seeds."""
    views: dict[str, list[tuple[float, float]]] = {}
    for row in result["rows"]:
        if (row["set"], row["kind"]) == (name, kind):
            for view, figures in row["views"].items():
                views.setdefault(view, []).append((figures["gained"], figures["ssim"]))
    return np.array([np.mean(views[view], axis=0) for view in sorted(views)])


def report(result: dict[str, Any]) -> str:
    """The table: what the photographs that are usually held out add to a scene."""
    lines = [
        "# What training on every photograph gains",
        "",
        f"`python -m bench.real.all_views --write`: drafts {WIDTH} px wide, seeds: "
        f"{1 + max(row['seed'] for row in result['rows'])}. {words(result['machine'])}.",
        "",
        f"Every view is held out once by the script, one in {FOLDS} at a time, and judges a draft of all "
        "others and one of seven in eight of them. Held-out dB after a gain a channel; behind +-: the "
        "standard error over views of the difference.",
        "",
        "| set | views | seven in eight, dB | all, dB | gain, dB | gain, SSIM | views that lose |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(row["set"] for row in result["rows"]):
        every, usual = (by_view(result, name, kind) for kind in KINDS)
        gain = every - usual
        mean, error = gain.mean(axis=0), gain.std(axis=0, ddof=1) / np.sqrt(len(gain))
        lines.append(
            f"| {name} | {len(gain)} | {usual[:, 0].mean():.2f} | {every[:, 0].mean():.2f} "
            f"| {mean[0]:+.2f} +- {error[0]:.2f} | {mean[1]:+.3f} +- {error[1]:.3f} "
            f"| {(gain[:, 0] < 0).sum()} of {len(gain)} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", nargs="+", default=SETS)
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "real_all_views", result, report(result))


if __name__ == "__main__":
    main()
