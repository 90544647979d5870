"""Number of alike views each view is matched with: the accuracy and the time of poses over it.

    python -m bench.calibration.at_size.alike [--quick] [--json] [--write] [--work FOLDER]

rig: the demo rig, 108 views of 240 px on its arc. walk: 100 photographs of 1600 px around a house
(`bench/support/walk.py`). The poses of both are known. `ALIKE` of calib/data/pairs.py is chosen here. Matches
are kept from row to row and finished rows in FOLDER; seconds are those of the processor that matching the
pairs of a row takes, by the mean of some. --quick: the rig alone.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from bench.calibration.at_size.full_size import truth_of
from bench.calibration.at_size.many_views import question, row, session_of
from bench.support import walk
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.data import pairs as chosen
from calib.data.matching import match
from calib.data.unfinished import Unfinished
from capture.imports.photos import import_photos
from imaging.arrays import Array
from imaging.compute.threads import one_thread_a_product
from imaging.session.session import Session
from imaging.session.view_id import ViewId

COUNTS = (5, 10, 20)
WALKED, WALK_SIZE = 100, (1600, 1200)
TIMED = 20
"""Pairs whose matching is timed."""


def walk_of(work: Path) -> tuple[Path, dict[ViewId, Array]]:
    """The session of the walk, and its true poses."""
    photographs, session = walk.photographs(work, WALKED, WALK_SIZE), work / "alike-walk"
    if not (session / "session.json").is_file():
        import_photos(photographs, session)
    poses = truth_of(photographs)
    shots = Session.open(session).shots()
    return session, {
        ViewId(shot.frame, shot.camera): poses[Path(shot.source or shot.file).name] for shot in shots
    }


def measured(name: str, work: Path, cache: Cache) -> dict[str, Any]:
    """Rows of a set by the count of alike views."""
    session, truth = walk_of(work) if name == "walk" else session_of(name, work)
    inputs, cameras = question(session)
    inputs = replace(inputs, unfinished=Unfinished(work / f"alike-{name}-matches", name))
    descriptors = {view: one.descriptors for view, one in inputs.features.items()}
    rows = {}
    for count in COUNTS:
        with mock.patch.object(chosen, "ALIKE", count):
            pairs = chosen.pairs_to_match(descriptors, inputs.rigs)
            cached = cache.get(f"alike {name} {count}", partial(row, inputs, cameras, "incremental", truth))
        rows[count] = cached | {"pairs": len(pairs)}
    return {"rows": rows, "a_pair": seconds_of_a_pair(list(descriptors.values()))}


def seconds_of_a_pair(descriptors: Sequence[Any]) -> float:
    """Processor seconds of matching two views of a set, the mean of some."""
    match(descriptors[0], descriptors[1])
    with one_thread_a_product():
        began = time.process_time()
        for number in range(TIMED):
            match(descriptors[number], descriptors[number + 1])
        return (time.process_time() - began) / TIMED


def table(result: dict[str, Any]) -> str:
    lines = [
        "# How many alike views a view is matched with",
        "",
        f"`python -m bench.calibration.at_size.alike --write`. {words(result['machine'])}. "
        "Processor seconds.",
        "",
        f"`rig calibrate` takes {chosen.ALIKE}.",
        "",
        "| set | alike | pairs | placed | AUC@1 | rotation, degrees | direction, degrees | matching, s |",
        "|" + "---|" * 8,
    ]
    for name, one in result["sets"].items():
        for count, figures in one["rows"].items():
            lines.append(
                f"| {name} | {count} | {figures['pairs']:,} | {figures['placed']} of {figures['views']} "
                f"| {figures['auc_1']:.3f} | {figures['rotation']:.4f} | {figures['direction']:.4f} "
                f"| {figures['pairs'] * one['a_pair']:.0f} |"
            )
    return "\n".join(lines) + "\n"


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "alike.jsonl")
    names = ("rig",) if options.quick else ("rig", "walk")
    return {"machine": machine(), "sets": {name: measured(name, options.work, cache) for name in names}}


def main() -> None:
    options = arguments(__doc__, seeds=1).parse_args()
    result = measure(options)
    deliver(options, "alike", result, table(result))


if __name__ == "__main__":
    main()
