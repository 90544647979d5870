"""Views that stand wrongly in path-traced scenes where parts look alike, with and without checks of poses.

    python -m bench.calibration.foreign_poses [--quick] [--json] [--write] [--work FOLDER] [--scenes
    crate,cube,...]

Twenty scenes, rendered by Mitsuba, photographed as RAW brackets or as JPEGs of one exposure, and calibrated
up to where views are placed, left out or refused; what follows only refines. The same model is compared with
the truth as it comes from structure from motion (without the checks), and as the checks leave it. wrong: a
view that is turned by more than 2 degrees or shifted by more than 2 % of the rig against those that agree
best. in silence: wrong, though the poses are neither refused nor doubted. Features and matches are kept under
--work; matches that are kept are verified again. --quick: two scenes.
"""

import argparse
import pickle
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from bench.calibration.foreign_scenes import DEVELOPED, SCENES
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from calib import all_views, view_images
from calib.calibrate import calibrate
from calib.data import features, matching
from calib.poses import first_model, resolution
from imaging.errors import CalibrationError, PartialError
from imaging.session.view_id import ViewId
from tests.foreign import truth
from tests.foreign.photographs import session

CHECK = "pose_contradictions"


class Placed(Exception):
    """Calibration has come to where views are placed."""


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
    kept: dict[str, Any] = {}
    if (folder / "kept.pkl").exists():
        kept = pickle.loads((folder / "kept.pkl").read_bytes())
    row: dict[str, Any] = {"scene": name, "kind": "JPEG" if name in DEVELOPED else "RAW"}
    row |= {"views": len(scene.poses), "before": _judged({}, scene.poses), "doubts": [], "refused": ""}

    def settled(reconstruction: Any, matches: Any, **more: Any) -> Any:
        row["before"] = _judged(_poses(reconstruction), scene.poses)
        try:
            done = settle(reconstruction, matches, **more)
        except CalibrationError as error:
            row["refused"] = str(error)
            raise
        row["after"] = _judged(_poses(done.reconstruction), scene.poses)
        row["doubts"] = [rung.name for rung in done.rungs if rung.taken and rung.name != CHECK]
        raise Placed

    settle = resolution.resolve_contradictions
    with ExitStack() as stack:
        stack.enter_context(patch.object(first_model, "resolve_contradictions", settled))
        _keep(kept, stack)
        try:
            calibrate(folder / "session")
        except Placed:
            pass
        except (CalibrationError, PartialError) as error:
            row["refused"] = row["refused"] or str(error)
            row["after"] = _judged({}, scene.poses)
    (folder / "kept.pkl").write_bytes(pickle.dumps(kept))
    return row


def _keep(kept: dict[str, Any], stack: ExitStack) -> None:
    """Let calibration use stored summaries and matches, and store those that are missing."""
    summaries = kept.setdefault("summaries", {})
    pairs = kept.get("pairs")

    def summary(session: Any, view: Any, *rest: Any) -> Any:
        if view.id not in summaries:
            summaries[view.id] = view_images.summarise(session, view, *rest)
        return summaries[view.id]

    def filled(database: Any, cameras: Any, images: Any, *rest: Any) -> Any:
        view_of = {id(own.descriptors): view for view, own in images.items()}

        def matched(first: Any, other: Any) -> Any:
            if pairs is None:
                return matching.match(first, other)
            pair = pairs.get((view_of[id(first)], view_of[id(other)]))
            return np.empty((0, 2), np.uint32) if pair is None else pair.index

        with patch.object(features, "match", matched):
            verified = features.fill_database(database, cameras, images, *rest)
        if pairs is None:
            kept["pairs"] = verified
        return verified

    stack.enter_context(patch.object(all_views, "summarise", summary))
    stack.enter_context(patch.object(first_model, "fill_database", filled))


def _poses(reconstruction: Any) -> dict[int, Any]:
    """cam_from_world [4, 4] of the frames of one camera that are placed."""
    images = (reconstruction.image(index) for index in reconstruction.reg_image_ids())
    return {
        ViewId.of_image(image.name).frame: np.vstack([image.cam_from_world().matrix(), (0, 0, 0, 1)])
        for image in images
    }


def _judged(placed: dict[int, Any], true: Any) -> dict[str, int]:
    return {"placed": len(placed), "wrong": len(truth.errors(placed, true).wrong)}


def silent(row: dict[str, Any]) -> bool:
    """Return whether views stand wrongly and nothing says so."""
    return row["after"]["wrong"] > 0 and not row["doubts"]


TOLD = {
    "pose_lit_differently": "lit differently",
    "pose_unconfirmed": "nothing confirms them",
    "pose_undecided": "undecided",
}


def warned(row: dict[str, Any]) -> str:
    """Return the warnings about poses that are not to be trusted."""
    if row["refused"]:
        return "refused"
    said = [f"warned: {TOLD[name]}" for name in row["doubts"]]
    return ", ".join(said) or ("**in silence**" if silent(row) else "")


def table(result: dict[str, Any], options: argparse.Namespace) -> str:
    """Markdown."""
    rows = result["rows"]
    bad = [row["scene"] for row in rows if silent(row)]
    lines = [
        "# Views that stand wrongly where parts of a scene look alike",
        "",
        f"`python -m bench.calibration.foreign_poses --write`: {len(rows)} of {len(SCENES)} "
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
