"""Sessions of a scene for bench/calibration/poses.py: simulated rigs against their truth, and photographs."""

import shutil
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

from bench.calibration.pose_error import of_session
from bench.support.plain_pycolmap import place
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from capture.simulated import capture_simulated
from drivers.sim.rigs import simulate
from imaging.files.colmap import pycolmap
from imaging.session.calibration import CalibrationRecord

WIDTH = 1600
"""px; the size at which calibration looks for features in larger photographs."""


class Meter:
    """Time of each part of a calibration."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._part, self._since = "", time.perf_counter()

    def __call__(self, message: str, done: int, total: int) -> None:
        """Record the progress of a calibration."""
        now = time.perf_counter()
        self.seconds[self._part] = self.seconds.get(self._part, 0.0) + now - self._since
        self._part, self._since = message, now


def timed(session: Path) -> tuple[CalibrationRecord, dict[str, float]]:
    """Calibrate; seconds of all, and of stating how sure it is."""
    meter, began = Meter(), time.perf_counter()
    record = calibrate(session, on_progress=meter)
    seconds = time.perf_counter() - began
    return record, {"seconds": seconds, "sure_seconds": meter.seconds.get("measuring how sure it is", 0.0)}


def trial(seed: int, stops: int, width: int) -> dict[str, Any]:
    """The demo rig at all its positions, with the light that many stops brighter, pictures 4:3."""
    with TemporaryDirectory() as folder:
        session = Path(folder) / "session"
        altered = partial(simulate, light=2.0**stops, width=width, height=width * 3 // 4)
        with mock.patch("capture.simulated.simulate", altered):
            capture_simulated("demo", session, seed=seed)
        record, seconds = timed(session)
        return of_session(session, record) | seconds


def photographs(folder: Path) -> dict[str, Any]:
    """Photographs of one camera: ours, and what pycolmap makes of them with its defaults at the same size."""
    with TemporaryDirectory() as work:
        session = Path(work) / "session"
        pictures = Path(work) / "pictures"
        pictures.mkdir()
        for path in sorted(folder.glob("*.[jJ][pP][gG]")):
            shutil.copy(path, pictures / path.name)
        import_photos(pictures, session)
        record, seconds = timed(session)
        model = pycolmap.Reconstruction(str(session / "calibration" / "colmap"))
        ours = {
            "registered": len(record.views),
            "images": len(record.views) + len(record.unregistered),
            "reprojection_px": record.reprojection_px,
            **_counts(model),
            **seconds,
        }
        return {"rig": ours, "pycolmap": plain(pictures, Path(work))}


def _counts(model: Any) -> dict[str, Any]:
    return {
        "points": int(model.num_points3D()),
        "observations": int(model.compute_num_observations()),
        "track_length": float(model.compute_mean_track_length()),
    }


def plain(pictures: Path, work: Path) -> dict[str, Any]:
    """SIFT, all pairs, incremental mapping: pycolmap's defaults, but for the size of the pictures."""
    began = time.perf_counter()
    options = pycolmap.FeatureExtractionOptions()
    options.max_image_size = WIDTH
    single = pycolmap.CameraMode.SINGLE
    best, _ = place(pictures, work / "plain", camera_mode=single, extraction_options=options)
    seconds = time.perf_counter() - began
    if best is None:
        return {"registered": 0, "seconds": seconds}
    camera = next(iter(best.cameras.values()))
    # pycolmap scales what it finds in a smaller picture to the size of the photograph.
    scale = min(WIDTH / max(camera.width, camera.height), 1.0)
    return {
        "registered": int(best.num_reg_images()),
        "images": len(list(pictures.iterdir())),
        "reprojection_px": scale * float(best.compute_mean_reprojection_error()),
        **_counts(best),
        "seconds": seconds,
    }
