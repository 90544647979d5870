"""Calibration of many views: the pairs that are matched beside all pairs, and the two mappers of COLMAP.

    python -m bench.calibration.at_size.many_views [--quick] [--json] [--write] [--work FOLDER]

rig: the demo rig, 108 views of 240 px on its arc, poses known. castle: the photographs `sceaux`, where
RIG_DATA names the folder that has them. Pairs are chosen as for any calibration, or are all. The incremental
mapper is the one that `rig calibrate` uses; the global one (GLOMAP) takes its place in a calibration that is
the same otherwise. The castle also by pycolmap's defaults at the same size. Seconds are those of the
processor. Matches are kept from row to row, and finished rows, in FOLDER. --quick: the castle alone.
"""

import argparse
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from bench.calibration.pose_error import auc, pairs, true_poses
from bench.calibration.scene import plain
from bench.support.record import arguments, deliver, machine, words
from bench.support.spent import processor_seconds
from bench.support.trial import Cache
from calib.calibrate import calibrate
from calib.data import features as matched
from calib.data import pairs as chosen
from calib.data.unfinished import FOLDER, Unfinished
from calib.poses import first_model, mapping, sfm
from calib.poses.pose_inputs import PoseInputs
from calib.poses.steps import Growth
from capture.imports.photos import import_photos
from capture.simulated import capture_simulated
from drivers.sim.rigs import simulate
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.progress import Progress
from imaging.session.view_id import ViewId

CASTLE = "sceaux"
POSITIONS, WIDTH = 27, 240


class Meter:
    """Processor seconds of each part of a calibration."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._part, self._since = "", processor_seconds()

    def __call__(self, message: str, done: int, total: int) -> None:
        """Record the progress of a calibration."""
        now = processor_seconds()
        self.seconds[self._part] = self.seconds.get(self._part, 0.0) + now - self._since
        self._part, self._since = message, now


class _Known(Exception):
    """Known inputs of `sfm.solve`."""


def global_mapper(
    database: Any,
    images: Sequence[str],
    max_error: float,
    fixed: frozenset[int],
    threads: int,
    progress: Progress,
    growth: Growth,
    ahead: bool = False,
) -> Any | None:
    """Map as `calib.poses.mapping.map_views`, all views at once (Pan et al., "Global Structure-from-Motion
    Revisited", 2024). growth, ahead: it knows neither.
    """
    views = len(images)
    progress("placing views", 0, views)
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = options.mapper.num_threads = threads
    options.random_seed = options.mapper.random_seed = 0
    options.min_model_size = 2
    models = pycolmap.ReconstructionManager()
    pycolmap.GlobalPipeline(options, database, models).run()
    progress("placing views", views, views)
    every = [models.get(index) for index in range(models.size())]
    return max(every, key=lambda model: model.num_reg_images(), default=None)


MAPPERS = {"incremental": mapping.map_views, "global": global_mapper}
CHOSEN = tuple(f"chosen, {mapper}" for mapper in MAPPERS)


def session_of(name: str, work: Path) -> tuple[Path, dict[ViewId, Array] | None]:
    """The session of a set, and its true poses where they are known."""
    folder = work / f"size-{name}"
    if name == "rig":
        if not (folder / "truth" / "truth.json").is_file():
            altered = partial(simulate, positions=POSITIONS, width=WIDTH, height=WIDTH * 3 // 4)
            with mock.patch("capture.simulated.simulate", altered):
                capture_simulated("demo", folder, seed=100)
        return folder, true_poses(folder)
    if not (folder / "session.json").is_file():
        import_photos(Path(os.environ["RIG_DATA"]) / CASTLE, folder)
    return folder, None


def question(session: Path) -> tuple[PoseInputs, Mapping[str, Lens]]:
    """Return what a calibration asks `sfm.solve`."""
    asked: list[tuple[PoseInputs, Mapping[str, Lens]]] = []

    def noted(inputs: PoseInputs, cameras: Mapping[str, Lens]) -> None:
        asked.append((inputs, cameras))
        raise _Known

    with mock.patch.object(sfm, "solve", noted), suppress(_Known):
        calibrate(session)
    return asked[0]


def row(inputs: PoseInputs, cameras: Mapping[str, Lens], mapper: str, truth: Any) -> dict[str, Any]:
    """Row of one calibration from its features on; verified: number of fitting matches of each pair."""
    meter, verified_counts = Meter(), dict[str, int]()

    def fill(*values: Any) -> Any:
        verified = matched.fill_database(*values)
        verified_counts.update({_text(pair): len(matches.one) for pair, matches in verified.items()})
        return verified

    with (
        mock.patch.object(first_model, "map_views", MAPPERS[mapper]),
        mock.patch.object(first_model, "fill_database", fill),
    ):
        try:
            model = sfm.solve(replace(inputs, progress=meter), cameras)
        except CalibrationError as error:
            return {"refused": str(error), "verified": verified_counts}
    meter("", 0, 0)
    poses = {view: pose.matrix() for view, pose in model.poses.items()}
    result: dict[str, Any] = {
        "views": len(inputs.features),
        "placed": len(poses),
        "reprojection_px": model.reprojection_px,
        "points": int(model.reconstruction.num_points3D()),
        "verified": verified_counts,
        "seconds": meter.seconds,
    }
    if truth is not None:
        errors = pairs(poses, truth)
        placed = errors[np.isfinite(errors[:, 0])]
        result |= {"auc_1": auc(errors, 1.0), "rotation": float(np.median(placed[:, 0]))}
        result |= {"direction": float(np.median(placed[:, 1]))}
    return result


def measured(name: str, work: Path, cache: Cache) -> dict[str, Any]:
    """All rows of a set, as the table has them."""
    session, truth = session_of(name, work)
    inputs, cameras = question(session)
    inputs = replace(inputs, unfinished=Unfinished(work / f"size-{name}-matches"))
    features, rigs = inputs.features, inputs.rigs
    selected = set(chosen.pairs_to_match({view: one.descriptors for view, one in features.items()}, rigs))
    every, views = list(combinations(features, 2)), len(features)
    rows = {
        f"chosen, {mapper}": cache.get(
            f"{name} chosen {mapper}", partial(row, inputs, cameras, mapper, truth)
        )
        for mapper in MAPPERS
    }
    result: dict[str, Any] = {"views": views, "chosen": len(selected), "rows": rows}
    result["features"] = float(np.mean([len(one.points) for one in features.values()]))
    if len(selected) == len(every):
        return result
    with mock.patch.object(chosen, "ALL_PAIRS", views):
        rows["all, incremental"] = cache.get(
            f"{name} all incremental", partial(row, inputs, cameras, "incremental", truth)
        )
    verified = rows["all, incremental"]["verified"]
    matches = [verified[_text(pair)] for pair in selected if _text(pair) in verified]
    result["recall"] = len(matches) / len(verified)
    result["recall_matches"] = sum(matches) / sum(verified.values())
    return result


def _text(pair: tuple[ViewId, ViewId]) -> str:
    return f"{pair[0]} {pair[1]}"


def whole_by_rig(work: Path) -> dict[str, Any]:
    """The castle calibrated by rig, to the last file."""
    session, _ = session_of("castle", work)
    shutil.rmtree(session / FOLDER, ignore_errors=True)
    began = processor_seconds()
    record = calibrate(session)
    seconds = processor_seconds() - began
    shutil.rmtree(session / "calibration")
    return {"registered": len(record.views), "reprojection_px": record.reprojection_px, "seconds": seconds}


def whole_by_peer(work: Path) -> dict[str, Any]:
    """The same by pycolmap's defaults."""
    folder = work / "size-castle-peer"
    shutil.rmtree(folder, ignore_errors=True)
    pictures = folder / "pictures"
    pictures.mkdir(parents=True)
    for path in sorted((Path(os.environ["RIG_DATA"]) / CASTLE).glob("*.[jJ][pP][gG]")):
        shutil.copy(path, pictures / path.name)
    began = processor_seconds()
    figures = plain(pictures, folder)
    return figures | {"seconds": processor_seconds() - began}


def table(result: dict[str, Any]) -> str:
    lines = [
        "# Calibration of many views",
        "",
        f"`python -m bench.calibration.at_size.many_views --write`. {words(result['machine'])}. "
        "Processor seconds.",
        "",
        "## Pairs",
        "",
        "| set | views | features each | pairs matched | of all verified pairs | of all their matches |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in result["sets"].items():
        views, recall = one["views"], one.get("recall")
        shares = "all | all" if recall is None else f"{recall:.3f} | {one['recall_matches']:.3f}"
        lines.append(
            f"| {name} | {views} | {one['features']:.0f} | {one['chosen']:,} of {views * (views - 1) // 2:,} "
            f"| {shares} |"
        )
    lines += [
        "",
        "## Mappers",
        "",
        "| set | pairs, mapper | placed | AUC@1 | rotation, degrees | direction, degrees | px "
        "| s of matching | s of placing | s of the rest |",
        "|" + "---|" * 10,
    ]
    for name, one in result["sets"].items():
        for case, of_case in one["rows"].items():
            if "refused" in of_case:
                lines.append(f"| {name} | {case} | refused: {of_case['refused']} | | | | | | | |")
                continue
            truth = [
                f"{of_case[key]:.3f}" if key in of_case else "" for key in ("auc_1", "rotation", "direction")
            ]
            rest = (
                sum(of_case["seconds"].values())
                - of_case["seconds"]["matching"]
                - of_case["seconds"]["placing views"]
            )
            lines.append(
                f"| {name} | {case} | {of_case['placed']} of {of_case['views']} | {' | '.join(truth)} "
                f"| {of_case['reprojection_px']:.3f} | {_matching(one['rows'], case):.0f} "
                f"| {of_case['seconds']['placing views']:.0f} | {rest:.0f} |"
            )
    lines += ["", "## Whole calibrations", ""]
    lines += ["| photographs | by | placed | reprojection error, px | s |", "|---|---|---|---|---|"]
    for program, model in result["whole"].items():
        figures = f"{model['registered']} | {model['reprojection_px']:.3f} | {model['seconds']:.0f}"
        lines.append(f"| castle | {program} | {figures} |")
    return "\n".join(lines) + "\n"


def _matching(rows: Mapping[str, Any], case: str) -> float:
    """Seconds that the pairs of a row take to be matched where nothing was kept."""
    first, again, mine = (float(rows[name]["seconds"]["matching"]) for name in (*CHOSEN, case))
    return first if case in CHOSEN else first - again + mine


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "size.jsonl")
    return {
        "machine": machine(),
        "sets": {
            name: measured(name, options.work, cache)
            for name in ("rig", "castle")
            if name == "castle" or not options.quick
        },
        "whole": {
            "rig": cache.get("castle by rig", partial(whole_by_rig, options.work)),
            "pycolmap": cache.get("castle by pycolmap", partial(whole_by_peer, options.work)),
        },
    }


def main() -> None:
    options = arguments(__doc__, seeds=1).parse_args()
    result = measure(options)
    deliver(options, "calibration_size", result, table(result))


if __name__ == "__main__":
    main()
