"""Photographs of buildings whose cameras were measured by laser, placed by rig and by pycolmap's defaults.

    python -m bench.real.poses.laser FOLDER [--quick] [--json] [--write] [--work FOLDER]
        [--sets fountain-P11,...]

FOLDER holds the benchmark of Strecha et al. ("On Benchmarking Camera Calibration and Multi-View Stereo for
High Resolution Imagery", CVPR 2008): six sets of 3072x2048 photographs without EXIF, lens distortion removed,
as https://github.com/openMVG/SfM_quality_evaluation publishes them. Neither program is given the focal
length. Camera centres are compared after the similarity that fits best, turns after the rotation that fits
all of them best. Each row is made in a process of its own, and kept in the work folder. --quick:
fountain-P11.
"""

import argparse
import shutil
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.own_process import row_of
from bench.support.plain_pycolmap import place
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.spent import processor_seconds
from bench.support.trial import Cache
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from imaging.arrays import Array
from imaging.errors import RigError
from imaging.files.colmap import pycolmap
from imaging.session.session import Session

SETS = ("fountain-P11", "Herz-Jesus-P8", "Herz-Jesus-P25", "entry-P10", "castle-P19", "castle-P30")
PLACE = "Benchmarking_Camera_Calibration_2008"
WRONG = 0.05
"""Distance in lengths of the scene's extent from which a centre counts as wrong."""


def truth(folder: Path) -> tuple[dict[str, Array], Array]:
    """Poses, cam_from_world [4, 4] in metres by stem of the photograph, and the camera matrix [3, 3]."""
    poses, matrix = {}, np.eye(3)
    for path in sorted((folder / "gt_dense_cameras").glob("*.camera")):
        numbers = np.array(path.read_text().split(), float)
        matrix, turn, centre = numbers[:9].reshape(3, 3), numbers[12:21].reshape(3, 3), numbers[21:24]
        pose = np.eye(4)
        # Published to six digits: as they are, their traces hide angles below 0.05 degrees.
        u, _, vt = np.linalg.svd(turn)
        turn = u @ vt
        pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ centre
        poses[path.name.split(".")[0]] = pose
    return poses, matrix


def _centres(poses: list[Array]) -> Array:
    return np.stack([-pose[:3, :3].T @ pose[:3, 3] for pose in poses])


def _spread(poses: list[Array]) -> float:
    """Size of the cloud of centres, which a similarity scales."""
    centres = _centres(poses)
    return float(np.linalg.norm(centres - centres.mean(0)))


def errors(poses: Mapping[str, Array], true: Mapping[str, Array]) -> dict[str, Any]:
    """Compare poses with true ones: distances of centres, m, and angles of turns, degrees, by view."""
    names = sorted(poses.keys() & true.keys())
    ours, goal = ([of[name] for name in names] for of in (poses, true))
    a, b = _centres(ours), _centres(goal)
    extent = float(np.linalg.norm(np.ptp(b, axis=0)))
    a, b = a - a.mean(0), b - b.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    scale = float(np.trace(np.diag(s) @ sign) / (a**2).sum())
    away = np.linalg.norm(scale * a @ (u @ sign @ vt).T - b, axis=1)
    between = [g[:3, :3].T @ o[:3, :3] for o, g in zip(ours, goal, strict=True)]
    u, _, vt = np.linalg.svd(np.sum(between, axis=0))
    common = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    cosines = [(np.trace(common.T @ turn) - 1) / 2 for turn in between]
    turns = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return {
        "placed": len(names),
        "extent": extent,
        "spread": _spread(goal),
        "centres": away.tolist(),
        "turns": turns.tolist(),
        "wrong": int((away > WRONG * extent).sum()),
    }


def by_rig(folder: Path, work: Path) -> dict[str, Any]:
    """Calibrate a set as `rig import` and `rig calibrate` do."""
    session = work / f"laser-{folder.name}"
    shutil.rmtree(session, ignore_errors=True)
    import_photos(folder / "images", session)
    began = processor_seconds()
    try:
        record = calibrate(session)
    except RigError as error:
        return {"placed": 0, "seconds": processor_seconds() - began, "said": [str(error)]}
    seconds = processor_seconds() - began
    names = {
        (shot.frame, shot.camera): Path(shot.source or shot.file).stem
        for shot in Session.open(session).shots("scene")
    }
    poses = {names[view.frame, view.camera]: view.cam_from_world.matrix() for view in record.views}
    lens = record.cameras[0].lens
    assert lens is not None, "a camera whose views have poses has a lens"
    row = errors(poses, truth(folder)[0])
    unit = row["spread"] / _spread(list(poses.values()))
    stated = [view.error for view in record.views if view.error is not None]
    return {
        "seconds": seconds,
        "focal": (lens.fx + lens.fy) / 2,
        "middle": [lens.cx, lens.cy],
        "said": list(record.doubts),
        "stated_centres": [unit * error.translation for error in stated],
        "stated_turns": [error.rotation for error in stated],
        **row,
    }


def by_pycolmap(folder: Path, work: Path) -> dict[str, Any]:
    """Place a set by pycolmap's defaults, with one camera."""
    images, single = folder / "images", pycolmap.CameraMode.SINGLE
    names = sorted(path.name for path in images.glob("*.jpg"))
    best, seconds = place(images, work / f"laser-{folder.name}-pycolmap", names, camera_mode=single)
    if best is None:
        return {"placed": 0, "seconds": seconds}
    poses = {}
    for number in best.reg_image_ids():
        pose = np.vstack([best.image(number).cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]])
        poses[Path(best.image(number).name).stem] = pose
    camera = next(iter(best.cameras.values()))
    lens = {
        "focal": camera.mean_focal_length(),
        "middle": [camera.principal_point_x, camera.principal_point_y],
    }
    return {"seconds": seconds, **lens, **errors(poses, truth(folder)[0])}


PROGRAMS = {"rig": by_rig, "pycolmap": by_pycolmap}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set and program, and the true lens."""
    alone = partial(row_of, "bench.real.poses.laser")
    cache, rows = Cache(options.work / "laser.jsonl"), {}
    for name in options.sets:
        folder = options.folder / PLACE / name
        poses, matrix = truth(folder)
        row: dict[str, Any] = {
            program: cache.get(f"{name} {program}", partial(alone, program, folder, options.work))
            for program in PROGRAMS
        }
        lens = {"focal": (matrix[0, 0] + matrix[1, 1]) / 2, "middle": [matrix[0, 2], matrix[1, 2]]}
        rows[name] = row | {"views": len(poses), "truth": lens}
    return {"machine": machine(), "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown."""
    lines = [
        "# Cameras measured by laser",
        "",
        f"`python -m bench.real.poses.laser FOLDER --write`. {words(result['machine'])}. Processor seconds.",
        "",
        "Six sets of photographs of buildings without EXIF (Strecha et al. 2008), nothing set by hand, "
        "beside pycolmap's defaults (exhaustive pairs, one camera). Centres: median and largest distance "
        "from the measured ones, mm, and the median in per cent of the extent of all centres. Turns: the "
        "same, degrees. Focal length: per cent above the published mean of both. Principal point: px from "
        "the published one. Stated: root mean square of the stated standard errors along the worst axis of "
        "each view; behind it, the true errors over them.",
        "",
        "| set | views | program | placed | centres, mm | % | turns | focal length | principal point "
        "| stated, mm | stated turns | s |",
        "|" + "---|" * 12,
    ]
    for name, row in result["rows"].items():
        for program in PROGRAMS:
            one = row[program]
            cells = [""] * 7
            if one["placed"]:
                centres, turns = 1000 * np.array(one["centres"]), np.array(one["turns"])
                off = np.linalg.norm(np.subtract(one["middle"], row["truth"]["middle"]))
                cells = [
                    f"{np.median(centres):.1f}, {centres.max():.0f}",
                    f"{np.median(centres) / one['extent'] / 10:.3f}",
                    f"{np.median(turns):.3f}, {turns.max():.3f}",
                    f"{100 * (one['focal'] / row['truth']['focal'] - 1):+.2f}",
                    f"{off:.1f}",
                    _stated(one, "centres"),
                    _stated(one, "turns"),
                ]
            lines.append(
                f"| {name} | {row['views']} | {program} | {one['placed']} | {' | '.join(cells)} "
                f"| {one['seconds']:.0f} |"
            )
    return "\n".join(lines) + "\n"


def _stated(row: Mapping[str, Any], kind: str) -> str:
    """Root mean square of stated errors and of the true ones over it; empty for a program without any."""
    if f"stated_{kind}" not in row:
        return ""
    stated, true = (float(np.sqrt(np.mean(np.square(row[key])))) for key in (f"stated_{kind}", kind))
    size = f"{1000 * stated:.1f}" if kind == "centres" else f"{stated:.3f}"
    return f"{size}, {true / stated:.1f}"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("folder", type=Path, help="a checkout of the benchmark")
    parser.add_argument("--work", type=Path, default=WORK / "laser", help="keeps sessions and finished rows")
    parser.add_argument("--sets", default=",".join(SETS), help="comma-separated")
    options = parser.parse_args()
    options.sets = SETS[:1] if options.quick else tuple(options.sets.split(","))
    options.work.mkdir(parents=True, exist_ok=True)
    result = measure(options)
    deliver(options, "laser", result, table(result), result["rows"])


if __name__ == "__main__":
    main()
