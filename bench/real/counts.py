"""Numbers of Gaussians that a set of few photographs can use in a whole training.

    python -m bench.real.counts [--quick] [--json] [--write] [--seeds 1] [--work FOLDER] [--sets ...]

The preset standard with other numbers of Gaussians, set by hand, at the width and on the folds of
`bench.real.more_time`: every view is held out once. A set is a name of that bench or a folder of
photographs. Finished rows are kept in FOLDER. --quick: the castle.
"""

import argparse
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.peers.compare import session_of
from bench.real.more_time import FOLDS, KINDS, WIDTH, fold_of, trained
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.arrays import Array
from imaging.session.session import Session
from recon.decide.steps.size import EACH, FLOOR

SETS = ("castle", "banana", "monstree", "brighton")
BY_VIEWS, MOST = 0, 40_000
"""`EACH` Gaussians for each photograph to train on, `FLOOR` at least; and the number of the preset."""
COUNTS = (10_000, BY_VIEWS, MOST)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set, number, fold and seed."""
    cache, rows = Cache(options.work / "real-counts.jsonl"), []
    sets = SETS[:1] if options.quick else options.sets
    for name, count, fold, seed in product(sets, options.counts, range(FOLDS), range(options.seeds)):

        def made(name: str = name, count: int = count, fold: int = fold, seed: int = seed) -> dict[str, Any]:
            session = session_of(name, options.work)
            gaussians = count or by_views(fold_of(session, fold, options.work))
            return trained(session, fold, options.work, "standard", seed, gaussians=gaussians)

        what = {"set": Path(name).name, "count": count, "fold": fold, "seed": seed}
        rows.append(what | cache.get(f"{name} {count} fold {fold} seed {seed}", made))
    return {"machine": machine(), "rows": rows}


def by_views(folder: Path) -> int:
    """Number of Gaussians for the photographs of a fold that are trained on."""
    split = Session.open(folder).split()
    assert split is not None, "a fold has a split"
    return max(EACH * len(split.train), FLOOR)


def by_view(result: dict[str, Any], name: str, count: int) -> Array:
    """Figures of every view of a set, [views, (dB, confirmed, others, SSIM)], means over seeds."""
    views: dict[str, list[list[float]]] = {}
    for row in result["rows"]:
        if (row["set"], row["count"]) == (name, count):
            for view, figures in row["views"].items():
                views.setdefault(view, []).append([figures[kind] for kind in KINDS])
    return np.array([np.mean(views[view], axis=0) for view in sorted(views)])


def report(result: dict[str, Any]) -> str:
    """The table of numbers by set, and what each adds to the largest."""
    rows = result["rows"]
    lines = [
        "# Numbers of Gaussians that few photographs can use",
        "",
        f"`python -m bench.real.counts --write`: preset standard, {WIDTH} px wide, no trials, seeds: "
        f"{1 + max(row['seed'] for row in rows)}. {words(result['machine'])}.",
        "",
        f"Every view is held out once, one in {FOLDS} at a time. Held-out dB after a gain a channel: of all "
        "pixels, of those whose depth another photograph confirms, and of the others; SSIM. By views: "
        f"{EACH:,} Gaussians for each training view, {FLOOR:,} at least. Gain: over the most, and its "
        "standard error over views.",
        "",
        "| set | views | Gaussians | dB | confirmed | others | SSIM | gain, dB | gain, SSIM | lose | s |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, count in dict.fromkeys((row["set"], row["count"]) for row in rows):
        views = by_view(result, name, count)
        db, shown, others, ssim = np.nanmean(views, axis=0)
        seconds = np.mean([row["seconds"] for row in rows if (row["set"], row["count"]) == (name, count)])
        gains = ["", "", ""]
        if count != MOST:
            gain = views - by_view(result, name, MOST)
            mean, error = gain.mean(axis=0), gain.std(axis=0, ddof=1) / np.sqrt(len(gain))
            gains = [f"{mean[0]:+.2f} +- {error[0]:.2f}", f"{mean[3]:+.3f} +- {error[3]:.3f}"]
            gains.append(f"{(gain[:, 0] < 0).sum()} of {len(gain)}")
        size = f"{count:,}" if count else "by views"
        lines.append(
            f"| {name} | {len(views)} | {size} | {db:.2f} | {shown:.2f} | {others:.2f} | {ssim:.3f} "
            f"| {' | '.join(gains)} | {seconds:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", nargs="+", default=SETS)
    parser.add_argument("--counts", nargs="+", type=int, default=COUNTS)
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "real_counts", result, report(result))


if __name__ == "__main__":
    main()
