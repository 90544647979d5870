"""Many photographs of 12 megapixels, calibrated by rig and by plain pycolmap, each in a process of its own.

    python -m bench.calibration.full_size rig|pycolmap COUNT FOLDER

The photographs are those of `bench.support.walk`, made in FOLDER where they are not there yet; their textures
are pieces of the photographs of `sceaux` and `monstree`, which RIG_DATA has. Prints a row of JSON: views that
were placed, errors against the truth, seconds of the processor and of the clock by part, peak memory.
pycolmap looks for features at the size that rig does, matches each photograph with the ten after it and with
those 2^k after it, which closes the ring, and places them by its incremental mapper; all else is its default.
"""

import json
import os
import resource
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.calibration.pose_error import Array, auc, pairs
from bench.calibration.scene import WIDTH
from bench.support import walk
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from imaging.files.colmap import pycolmap
from imaging.session.session import Session
from imaging.session.view_id import ViewId


class Clock:
    """Seconds of each part, of the processor and of the clock."""

    def __init__(self) -> None:
        self.parts: dict[str, tuple[float, float]] = {}
        self._part, self._since = "", self._now()

    def _now(self) -> tuple[float, float]:
        return time.process_time(), time.perf_counter()

    def __call__(self, message: str, done: int, total: int) -> None:
        """As a calibration reports its progress."""
        now = self._now()
        before = self.parts.get(self._part, (0.0, 0.0))
        self.parts[self._part] = tuple(b + n - s for b, n, s in zip(before, now, self._since, strict=True))  # type: ignore[assignment]
        self._part, self._since = message, now


def photographs(work: Path, count: int) -> Path:
    """The folder of that many photographs, made if need be; their truth is in the file of the same name."""
    folder = work / f"walk-{count}"
    if not folder.with_suffix(".json").is_file():
        data = Path(os.environ["RIG_DATA"])
        sources = [
            *sorted(data.glob("sceaux/*.[jJ][pP][gG]"))[::3],
            *sorted(data.glob("monstree/*.jpg"))[::5],
        ]
        walk.take(walk.house(sources), count, folder)
    return folder


def truth_of(folder: Path) -> dict[str, Array]:
    """True cam_from_world [4, 4] by name of the photograph."""
    poses = json.loads(folder.with_suffix(".json").read_text())
    return {name: np.array(pose) for name, pose in poses.items()}


def by_rig(work: Path, count: int) -> dict[str, Any]:
    """Imported and calibrated, to the last file."""
    folder, session = photographs(work, count), work / f"walk-{count}-session"
    shutil.rmtree(session, ignore_errors=True)
    clock = Clock()
    clock("importing", 0, 1)
    import_photos(folder, session)
    record = calibrate(session, progress=clock)
    clock("", 0, 0)
    names = {
        ViewId(shot.frame, shot.camera): Path(shot.original or shot.file).name
        for shot in Session.open(session).shots()
    }
    poses = {names[view.id]: view.cam_from_world.matrix() for view in record.views}
    return _row(poses, truth_of(folder), clock, record.reprojection_px or 0.0, record.points)


def by_peer(work: Path, count: int) -> dict[str, Any]:
    """Features, sequential matching and incremental mapping of pycolmap."""
    folder, own = photographs(work, count), work / f"walk-{count}-peer"
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir()
    database = own / "plain.db"
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = WIDTH
    clock = Clock()
    steps: dict[str, Callable[[], Any]] = {
        "finding features": lambda: pycolmap.extract_features(
            database, folder, camera_mode=pycolmap.CameraMode.SINGLE, extraction_options=options
        ),
        "matching": lambda: pycolmap.match_sequential(database),
        "placing views": lambda: pycolmap.incremental_mapping(database, folder, own),
    }
    models: Any = {}
    for name, step in steps.items():
        clock(name, 0, 1)
        models = step()
        print(name, file=sys.stderr)
    clock("", 0, 0)
    best = max(models.values(), key=lambda model: model.num_reg_images())
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
    errors = pairs(poses, truth)  # type: ignore[arg-type]
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
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    }


PROGRAMS = {"rig": by_rig, "pycolmap": by_peer}

if __name__ == "__main__":
    print(json.dumps(PROGRAMS[sys.argv[1]](Path(sys.argv[3]), int(sys.argv[2]))))
