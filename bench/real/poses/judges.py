"""Real photographs with known facts, calibrated by rig and by pycolmap's defaults, each in a process of its
own.

    python -m bench.real.poses.judges [--quick] [--json] [--write] [--work FOLDER] [--sets fox,banana,...]

With --write the table of goals in docs/figures.md is written, too (`bench/real/goals.py`).

Sets under RIG_DATA, at full size. pycolmap looks for features at its own size, matches all pairs and maps
them, with one camera. Camera centres are compared with those that are published (fox), after the similarity
that fits best; heights and tilts with GPS and gimbal (brighton). EXIF's focal length is that of its
35 mm equivalent or of the sensor's size, px. One set is made, of path-traced metal and glass, whose poses are
known: brackets for rig, fused exposures for pycolmap. What is invented: exposure, white balance or
falloff that calibration takes. Rows are kept in FOLDER. --quick: sceaux.
"""

import argparse
import json
import os
import shutil
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

from bench.real.goals import write_page
from bench.real.made_sets import METAL, fuse, judged, metal_and_glass
from bench.support.own_process import row_of
from bench.support.plain_pycolmap import place
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.spent import processor_seconds
from bench.support.trial import Cache
from calib.calibrate import calibrate
from calib.sensor.focal_length import focal_length
from capture.imports.photos import import_photos
from imaging.arrays import Array
from imaging.errors import RigError
from imaging.files.colmap import pycolmap
from imaging.files.photo import read_metadata
from imaging.session.calibration import CalibrationRecord, ViewCalibration
from imaging.session.session import Session

SETS: Mapping[str, str] = {
    "fox": "fox/images/*.jpg",
    "banana": "banana/*.JPG",
    "brighton": "brighton/*.JPG",
    "sceaux": "sceaux/*.[jJ][pP][gG]",
    "monstree": "monstree/*.jpg",
    "lund": "lund/*.jpg",
    METAL: "",
}
"""Photographs of each set; those of the last are made."""
PUBLISHED = {"fox": "fox/transforms.json"}
"""Poses that were published with a set."""
WRONG = 2.0
"""Per cent of the extent, by which a camera centre misses the published one that stands wrongly."""
PARTS = {
    "exposure_each_photograph": "exposure",
    "white_balance_each_photograph": "white balance",
    "vignetting": "falloff",
}


def photographs(name: str) -> list[Path]:
    """Files of a set."""
    if name == METAL:
        return metal_and_glass(WORK / "metal_and_glass")[0]
    return sorted(Path(os.environ["RIG_DATA"]).glob(SETS[name]))


def stated_focal(name: str) -> float | None:
    """Return what the first photograph of a set says of its focal length, px; None where it says nothing."""
    first = photographs(name)[0]
    with PIL.Image.open(first) as picture:
        focal = focal_length(read_metadata(first), *picture.size)
    return None if focal is None else focal.px


def published_centres(name: str) -> dict[str, Array] | None:
    """Camera centres [3] that were published with a set, by stem of the file name; None where none were."""
    if name not in PUBLISHED:
        return None
    frames = json.loads((Path(os.environ["RIG_DATA"]) / PUBLISHED[name]).read_text())["frames"]
    return {Path(one["file_path"]).stem: np.array(one["transform_matrix"])[:3, 3] for one in frames}


def away_of(centres: Mapping[str, Array], published: Mapping[str, Array]) -> Array:
    """Distances of centres from published ones, in per cent of the extent of these, after the similarity that
    fits best."""
    names = sorted(centres.keys() & published.keys())
    ours, goal = (np.stack([of[name] for name in names]) for of in (centres, published))
    a, b = ours - ours.mean(0), goal - goal.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    scale = float(np.trace(np.diag(s) @ sign) / (a**2).sum())
    away = np.linalg.norm(scale * a @ (u @ sign @ vt).T - b, axis=1)
    return np.asarray(100 * away / np.linalg.norm(np.ptp(goal, axis=0)))


def centre_errors(centres: Mapping[str, Array], published: Mapping[str, Array]) -> dict[str, float]:
    """Median and worst distance of centres from published ones, and how many stand wrongly."""
    away = away_of(centres, published)
    return {
        "centre_median": float(np.median(away)),
        "centre_worst": float(away.max()),
        "wrong": int((away > WRONG).sum()),
    }


def by_rig(name: str, work: Path) -> dict[str, Any]:
    """Return what `rig import` and `rig calibrate` make of a set."""
    session = work / f"judges-{name}"
    shutil.rmtree(session, ignore_errors=True)
    import_photos(photographs(name)[0].parent, session)
    began = processor_seconds()
    try:
        record = calibrate(session)
    except RigError as error:
        return {"placed": 0, "seconds": processor_seconds() - began, "said": [str(error)]}
    row: dict[str, Any] = {
        "placed": len(record.views),
        "seconds": processor_seconds() - began,
        "lens": [camera.lens.model for camera in record.cameras if camera.lens is not None],
        "focal": [camera.lens.fx for camera in record.cameras if camera.lens is not None],
        "taken": [PARTS[rung.name] for rung in record.rungs if rung.taken and rung.name in PARTS],
        "said": list(record.doubts),
    }
    if (stated := stated_focal(name)) is not None and row["focal"]:
        row["focal_off"] = 100 * abs(row["focal"][0] / stated - 1)
    sources = {
        (shot.frame, shot.camera): Path(shot.source or shot.file).stem
        for shot in Session.open(session).shots("scene")
    }
    if (published := published_centres(name)) is not None:
        centres = {sources[view.frame, view.camera]: _centre(view) for view in record.views}
        row |= centre_errors(centres, published)
    if name == METAL:
        poses = {view.frame: view.cam_from_world.matrix() for view in record.views}
        row |= judged(poses, metal_and_glass(WORK / "metal_and_glass")[1])
    if record.coordinates is not None and record.unit == "m":
        row |= _heights(session, record)
    return row


def _centre(view: ViewCalibration) -> Array:
    pose = view.cam_from_world.matrix()
    return np.asarray(-pose[:3, :3].T @ pose[:3, 3])


def _heights(session: Path, record: CalibrationRecord) -> dict[str, float]:
    """Span of the heights of cameras, how far the ground is below them, and median tilt of those that look
    down."""
    places = np.stack([_centre(view) for view in record.views])
    axes = np.stack([view.cam_from_world.matrix()[2, :3] for view in record.views])
    model = pycolmap.Reconstruction(str(session / "calibration" / "colmap"))
    points = np.stack([point.xyz for point in model.points3D.values()])
    return {
        "height_span": float(np.ptp(places[:, 2])),
        "ground_below": float(np.median(places[:, 2]) - np.median(points[:, 2])),
        "tilt": float(np.degrees(np.median(np.arccos(np.clip(-axes[:, 2], -1, 1))))),
    }


def by_pycolmap(name: str, work: Path) -> dict[str, Any]:
    """Return what pycolmap makes of a set by its defaults, with one camera."""
    folder = work / f"judges-{name}-pycolmap"
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "images").mkdir(parents=True)
    if name == METAL:
        fuse(photographs(name), folder / "images")
    else:
        for path in photographs(name):
            shutil.copy(path, folder / "images" / path.name)
    single = pycolmap.CameraMode.SINGLE
    best, seconds = place(folder / "images", folder / "models", camera_mode=single)
    if best is None:
        return {"placed": 0, "seconds": seconds}
    row: dict[str, Any] = {
        "placed": best.num_reg_images(),
        "seconds": seconds,
        "focal": [camera.mean_focal_length() for camera in best.cameras.values()],
    }
    if name == METAL:
        images = [best.image(index) for index in best.reg_image_ids()]
        poses = {
            int(image.name[:4]): np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
            for image in images
        }
        row |= judged(poses, metal_and_glass(WORK / "metal_and_glass")[1])
    if (published := published_centres(name)) is not None:
        centres = {
            Path(best.image(index).name).stem: best.image(index).projection_center()
            for index in best.reg_image_ids()
        }
        row |= centre_errors(centres, published)
    return row


PROGRAMS = {"rig": by_rig, "pycolmap": by_pycolmap}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set and program."""
    alone = partial(row_of, "bench.real.poses.judges")
    cache = Cache(options.work / "judges.jsonl")
    rows = {
        name: {
            program: cache.get(f"{name} {program}", partial(alone, program, name, options.work))
            for program in PROGRAMS
        }
        for name in options.sets
    }
    return {"machine": machine(), "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown."""
    lines = [
        "# Real photographs with known facts",
        "",
        f"`python -m bench.real.poses.judges --write`. {words(result['machine'])}. Processor seconds.",
        "",
        "Sets at full size, nothing set by hand, beside pycolmap's defaults (exhaustive pairs, one camera).",
        "",
        "| set | photographs | placed | by pycolmap | s | s of pycolmap | focal length, px | of pycolmap "
        "| EXIF | lens | parts of light taken | facts | warnings |",
        "|" + "---|" * 13,
    ]
    for name, row in result["rows"].items():
        rig, peer = row["rig"], row["pycolmap"]
        stated = stated_focal(name)
        lines.append(
            f"| {name} | {len(photographs(name))} | {rig['placed']} | {peer['placed']} "
            f"| {rig['seconds']:.0f} | {peer['seconds']:.0f} "
            f"| {_numbers(rig.get('focal'))} | {_numbers(peer.get('focal'))} "
            f"| {'' if stated is None else f'{stated:.0f}'} | {', '.join(rig.get('lens', []))} "
            f"| {', '.join(rig.get('taken', [])) or 'none'} | {_facts(rig, peer)} "
            f"| {'; '.join(rig.get('said', [])) or 'none'} |"
        )
    return "\n".join(lines) + "\n"


def _numbers(values: list[float] | None) -> str:
    return ", ".join(f"{value:.0f}" for value in values or [])


def _facts(rig: Mapping[str, Any], peer: Mapping[str, Any]) -> str:
    """Return what is known of a set otherwise, beside what was measured."""
    said = []
    if "wrong" in rig:
        said.append(f"{rig['wrong']} wrong, {peer['wrong']} by pycolmap")
    if "turn_median" in rig:
        said.append(
            f"turns off by {rig['turn_median']:.4f} degrees in the median, by pycolmap "
            f"{peer['turn_median']:.4f}"
        )
    if "centre_median" in rig:
        said.append(
            f"centres off by {rig['centre_median']:.3f} % of the extent in the median and "
            f"{rig['centre_worst']:.2f} at most, by pycolmap {peer['centre_median']:.3f} and "
            f"{peer['centre_worst']:.2f}"
        )
    if "height_span" in rig:
        said.append(
            f"heights of cameras within {rig['height_span']:.2f} m, ground {rig['ground_below']:.1f} m "
            f"below, axes tilted by {rig['tilt']:.2f} degrees"
        )
    return "; ".join(said)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK / "judges", help="keeps sessions and finished rows")
    parser.add_argument("--sets", default=",".join(SETS), help="comma-separated")
    options = parser.parse_args()
    options.sets = ("sceaux",) if options.quick else tuple(options.sets.split(","))
    options.work.mkdir(parents=True, exist_ok=True)
    result = measure(options)
    deliver(options, "real_judges", result, table(result), result["rows"])
    if options.write:
        write_page(result["rows"])


if __name__ == "__main__":
    main()
