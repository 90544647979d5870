"""Views that stand wrongly in path-traced scenes where parts look alike, with and without checks of poses.

    python -m bench.calibration.lookalikes.foreign_poses [--quick] [--json] [--write] [--work FOLDER]
    [--scenes crate,cube,...]

Twenty scenes, rendered by Mitsuba, photographed as RAW brackets or as JPEGs of one exposure, and calibrated
up to their poses. without: the first model of structure from motion; with: the poses that `rig calibrate`
would write. wrong: a view that is turned by more than 2 degrees or shifted by more than 2 % of the rig
against those that agree best. in silence: wrong, though the poses are neither refused nor doubted. Learned
features, an extra, are not used. Features and matches stay in the sessions, under --work, for another run.
--quick: two scenes.
"""

import argparse
from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from bench.calibration.lookalikes.foreign_scenes import DEVELOPED, SCENES
from bench.calibration.lookalikes.placed import FURTHER, place
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.data import learned
from tests.foreign import truth
from tests.foreign.photographs import session


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each scene."""
    cache = Cache(options.work / "foreign_poses.jsonl")
    rows = [cache.get(name, partial(one_scene, name, options.work / name)) for name in options.scenes]
    return {"machine": machine(), "rows": rows}


def one_scene(name: str, folder: Path) -> dict[str, Any]:
    """Return what became of the views of a scene."""
    scene = SCENES[name]()
    if not (folder / "session").exists():
        session(folder / "session", scene.light(), developed=name in DEVELOPED)
    without = ExitStack()
    without.enter_context(patch.object(learned, "available", lambda: False))
    placed = place(folder / "session", without)
    return {
        "scene": name,
        "kind": "JPEG" if name in DEVELOPED else "RAW",
        "views": len(scene.poses),
        "before": judged(placed.before or {}, scene.poses),
        "after": judged(placed.poses, scene.poses),
        "doubts": placed.doubts,
        "further": placed.taken(*FURTHER),
        "refused": placed.refused,
    }


def judged(poses: Mapping[Any, Any], true: Any) -> dict[str, int]:
    """Count the views of one camera that have poses, and those that stand wrongly."""
    by_frame = {view.frame: pose for view, pose in poses.items()}
    return {"placed": len(by_frame), "wrong": len(truth.errors(by_frame, true).wrong)}


def silent(row: dict[str, Any]) -> bool:
    """Return whether views stand wrongly and nothing says so."""
    return row["after"]["wrong"] > 0 and not row["doubts"]


WARNINGS = {
    "pose_lit_differently": "lit differently",
    "pose_unconfirmed": "nothing confirms them",
    "pose_undecided": "undecided",
    "pose_hanging": "one pair holds some",
    "pose_loose": "few points hold some",
}


def warned(row: dict[str, Any]) -> str:
    """Return the warnings of poses that are not to be trusted."""
    if row["refused"]:
        return "refused"
    said = [f"warned: {WARNINGS[name]}" for name in row["doubts"]]
    said += [name.replace("_", " ") for name in row["further"]]
    return ", ".join(said) or ("**in silence**" if silent(row) else "")


def table(result: dict[str, Any], options: argparse.Namespace) -> str:
    """Markdown."""
    rows = result["rows"]
    bad = [row["scene"] for row in rows if silent(row)]
    lines = [
        "# Views that stand wrongly where parts of a scene look alike",
        "",
        f"`python -m bench.calibration.lookalikes.foreign_poses --write`: {len(rows)} of {len(SCENES)} "
        "path-traced scenes, poses of "
        "structure from motion against the truth, without the checks of poses and with them. "
        f"{words(result['machine'])}.",
        "",
        "Left out: views without a pose, which are named. wrong: turned by more than 2 degrees, or shifted",
        "by more than 2 % of the rig, against the views that agree best.",
        "",
        "| scene | taken as | views | placed without | wrong | placed with | wrong | left out | warned |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        before, after = row["before"], row["after"]
        lines.append(
            f"| {row['scene']} | {row['kind']} | {row['views']} | {before['placed']} | {before['wrong']} "
            f"| {after['placed']} | {after['wrong']} | {row['views'] - after['placed']} | {warned(row)} |"
        )
    before, after = (
        {what: sum(row[when][what] for row in rows) for what in ("placed", "wrong")}
        for when in ("before", "after")
    )
    named = f" ({', '.join(bad)})" if bad else ""
    quiet = sum(row["after"]["wrong"] for row in rows if silent(row))
    lines += [
        "",
        f"All: without the checks {before['wrong']} of {before['placed']} placed views stand wrongly, with",
        f"them {after['wrong']} of {after['placed']}, {quiet} of these in silence{named}.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument(
        "--work", type=Path, default=WORK / "foreign", help="keeps sessions and finished rows"
    )
    parser.add_argument("--scenes", default=",".join(SCENES), help="comma-separated")
    options = parser.parse_args()
    options.scenes = ("crate-few", "facade") if options.quick else tuple(options.scenes.split(","))
    result = measure(options)
    deliver(options, "foreign_poses", result, table(result, options))


if __name__ == "__main__":
    main()
