"""Photographs of 12 megapixels, calibrated by rig and by plain pycolmap, each in a process of its own.

    python -m bench.calibration.at_size.full_size [--count 200] [--json] [--write] [--work FOLDER]

The photographs are those of `bench.support.walk`, made in FOLDER where they are not there yet; their textures
are pieces of the photographs of `sceaux` and `monstree`, which RIG_DATA has. Errors are those of all pairs of
views against the truth. pycolmap looks for features at the size that rig does, matches each photograph with
the ten after it and with those 2^k after it, which closes a ring, and places them by its incremental mapper;
all else is its default. A third row adjusts that model with the axis of the lens free. rig's ladder of lenses
was mended and its pairs were chosen on this walk. Memory is that of all processes at once, where what they
share counts for each. Finished rows are kept in FOLDER.
"""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.calibration.pose_error import auc, pairs
from bench.calibration.scene import WIDTH
from bench.support import walk
from bench.support.record import arguments, deliver, machine, words
from bench.support.spent import Memory, processor_seconds
from bench.support.trial import Cache
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.session.session import Session
from imaging.session.view_id import ViewId

TUNED = "pycolmap, axis freed"


class Clock:
    """Seconds of each part, of the processor and of the clock."""

    def __init__(self) -> None:
        self.parts: dict[str, tuple[float, float]] = {}
        self._part, self._since = "", self._now()

    def _now(self) -> tuple[float, float]:
        return processor_seconds(), time.perf_counter()

    def __call__(self, message: str, done: int, total: int) -> None:
        """Record the progress of a calibration."""
        now, before = self._now(), self.parts.get(self._part, (0.0, 0.0))
        spent = [b + n - s for b, n, s in zip(before, now, self._since, strict=True)]
        self.parts[self._part] = spent[0], spent[1]
        self._part, self._since = message, now


def truth_of(folder: Path) -> dict[str, Array]:
    """True cam_from_world [4, 4] by name of the photograph."""
    poses = json.loads(folder.with_suffix(".json").read_text())
    return {name: np.array(pose) for name, pose in poses.items()}


def by_rig(work: Path, count: int) -> dict[str, Any]:
    """Imported and calibrated, to the last file."""
    folder, session = walk.photographs(work, count), work / f"walk-{count}-session"
    shutil.rmtree(session, ignore_errors=True)
    clock = Clock()
    clock("importing", 0, 1)
    import_photos(folder, session)
    record = calibrate(session, on_progress=clock)
    clock("", 0, 0)
    names = {
        ViewId(shot.frame, shot.camera): Path(shot.source or shot.file).name
        for shot in Session.open(session).shots()
    }
    poses = {names[view.id]: view.cam_from_world.matrix() for view in record.views}
    return _row(poses, truth_of(folder), clock, record.reprojection_px or 0.0, record.points)


def by_peer(work: Path, count: int) -> dict[str, Any]:
    """Features, sequential matching and incremental mapping of pycolmap."""
    folder, output = walk.photographs(work, count), work / f"walk-{count}-peer"
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir()
    database = output / "plain.db"
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = WIDTH
    clock = Clock()
    steps: dict[str, Callable[[], Any]] = {
        "finding features": lambda: pycolmap.extract_features(
            database, folder, camera_mode=pycolmap.CameraMode.SINGLE, extraction_options=options
        ),
        "matching": lambda: pycolmap.match_sequential(database),
        "placing views": lambda: pycolmap.incremental_mapping(database, folder, output),
    }
    models: Any = {}
    for name, step in steps.items():
        clock(name, 0, 1)
        models = step()
        print(name, file=sys.stderr)
    best = max(models.values(), key=lambda model: model.num_reg_images())
    best.write(output)
    return _peer_row(best, folder, clock)


def by_tuned_peer(work: Path, count: int) -> dict[str, Any]:
    """Return what pycolmap made, adjusted once more with the axis of the lens free, as its users can."""
    folder, clock = walk.photographs(work, count), Clock()
    model = pycolmap.Reconstruction(work / f"walk-{count}-peer")
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    clock("adjusting", 0, 1)
    pycolmap.bundle_adjustment(model, options)
    return _peer_row(model, folder, clock)


def _peer_row(best: Any, folder: Path, clock: Clock) -> dict[str, Any]:
    clock("", 0, 0)
    poses = {
        best.image(index).name: np.vstack([best.image(index).cam_from_world().matrix(), [0, 0, 0, 1]])
        for index in best.reg_image_ids()
    }
    scale = WIDTH / walk.SIZE[0]
    error = scale * float(best.compute_mean_reprojection_error())
    return _row(poses, truth_of(folder), clock, error, int(best.num_points3D()))


def _row(
    poses: dict[str, Array], truth: dict[str, Array], clock: Clock, reprojection_px: float, points: int
) -> dict[str, Any]:
    errors = pairs(poses, truth)
    placed = errors[np.isfinite(errors[:, 0])]
    del clock.parts[""]
    return {
        "views": len(truth),
        "placed": len(poses),
        "auc_1": auc(errors, 1.0),
        "rotation": float(np.median(placed[:, 0])),
        "direction": float(np.median(placed[:, 1])),
        "worst": float(placed.max()),
        "reprojection_px": reprojection_px,
        "points": points,
        "seconds": {name: round(part[0], 1) for name, part in clock.parts.items()},
        "wall": {name: round(part[1], 1) for name, part in clock.parts.items()},
    }


PROGRAMS = {"rig": by_rig, "pycolmap": by_peer, TUNED: by_tuned_peer}


def apart(program: str, work: Path, count: int) -> dict[str, Any]:
    """The row of a program, in a process of its own, whose memory is that of nothing else."""
    command = [
        sys.executable,
        "-m",
        "bench.calibration.at_size.full_size",
        "--work",
        str(work),
        "--count",
        str(count),
    ]
    done = subprocess.run([*command, "--alone", program], check=True, stdout=subprocess.PIPE)
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return row


def table(result: dict[str, Any]) -> str:
    rows = result["rows"]
    count = next(iter(rows.values()))["views"]
    lines = [
        "# Calibration of photographs of 12 megapixels",
        "",
        f"`python -m bench.calibration.at_size.full_size --count {count} --write`. "
        f"{words(result['machine'])}.",
        "",
        f"{count} photographs of 4000x3000, poses known (`bench/support/walk.py`); features at {WIDTH} px.",
        "",
        "| by | placed | AUC@1 | rotation, degrees | direction, degrees | worst, degrees | px | points "
        "| processor s | s | memory, MB |",
        "|" + "---|" * 11,
    ]
    for name, row in rows.items():
        errors = [f"{row[key]:.3f}" for key in ("auc_1", "rotation", "direction", "worst", "reprojection_px")]
        seconds = [f"{sum(row[key].values()):.0f}" for key in ("seconds", "wall")]
        lines.append(
            f"| {name} | {row['placed']} of {row['views']} | {' | '.join(errors)} | {row['points']} "
            f"| {' | '.join(seconds)} | {row['memory_mb']:.0f} |"
        )
    lines += [
        "",
        f"{TUNED}: the model of the row above, adjusted again; its seconds are those of that alone.",
        "",
        "## Seconds of each part: of the processor, and of the clock",
        "",
        f"| part | {' | '.join(rows)} |",
        "|---" * (len(rows) + 1) + "|",
    ]
    for part in dict.fromkeys(part for row in rows.values() for part in row["seconds"]):
        spent = [(row["seconds"].get(part), row["wall"].get(part)) for row in rows.values()]
        cells = ("" if used is None else f"{used:.0f}, {wall:.0f}" for used, wall in spent)
        lines.append(f"| {part} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--alone", choices=list(PROGRAMS), help="Print one row, made in this process.")
    options = parser.parse_args()
    if options.alone is not None:
        with Memory() as memory:
            row = PROGRAMS[options.alone](options.work, options.count)
        print(json.dumps(row | {"memory_mb": memory.peak / 1e6}))
        return
    walk.photographs(options.work, options.count)
    cache = Cache(options.work / "full-size.jsonl")
    rows = {
        name: cache.get(f"{name} {options.count}", partial(apart, name, options.work, options.count))
        for name in PROGRAMS
    }
    result = {"machine": machine(), "rows": rows}
    deliver(options, "calibration_full_size", result, table(result))


if __name__ == "__main__":
    main()
