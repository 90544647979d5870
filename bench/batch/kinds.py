"""Small sessions of ten kinds of input, of which half can be reconstructed."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import cv2

from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from capture.simulated import capture_simulated
from drivers.sim.rigs import simulate
from imaging.session.session import Session

WIDTH, POSITIONS = 96, 4
RATE = 10
"""Frames of the video a second, and how long each view stands in it."""


def _captured(folder: Path, rig: str = "toy", frames: int = POSITIONS, **changed: Any) -> None:
    """Two cameras at some positions; changed: settings of the simulated rig."""
    small = partial(simulate, positions=frames, width=WIDTH, height=WIDTH * 3 // 4, samples=2, **changed)
    with mock.patch("capture.simulated.simulate", small):
        capture_simulated(rig, folder, seed=1)


def _middle_shots(folder: Path, **changed: Any) -> list[Path]:
    """The middle exposure of each view of a bracket of developed photographs, view by view; changed: settings
    of the simulated rig."""
    _captured(folder, "toy-ldr", **changed)
    views: dict[tuple[str, int], list[Path]] = {}
    for shot in Session.open(folder).shots("scene"):
        views.setdefault((shot.camera, shot.frame), []).append(folder / shot.file)
    return [files[len(files) // 2] for files in views.values()]


def _singles(folder: Path) -> None:
    photographs = folder.with_name("photographs")
    photographs.mkdir()
    for number, file in enumerate(_middle_shots(folder.with_name("brackets"))):
        shutil.copy(file, photographs / f"{number:02d}{file.suffix}")
    import_photos(photographs, folder)


def _video(folder: Path) -> None:
    path = folder.with_name("video.avi")
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), RATE, (WIDTH, WIDTH * 3 // 4))
    for file in _middle_shots(folder.with_name("frames"), frames=2 * POSITIONS, cameras=1):
        picture = cv2.imread(str(file))
        for _ in range(RATE):
            writer.write(picture)
    writer.release()
    import_photos(path, folder)


def _damaged(folder: Path) -> None:
    _captured(folder)
    file = folder / Session.open(folder).shots("scene")[5].file
    file.write_bytes(file.read_bytes()[:500])


def _missing(folder: Path) -> None:
    _captured(folder)
    (folder / Session.open(folder).shots("scene")[5].file).unlink()


def _calibrated(folder: Path) -> None:
    _captured(folder)
    calibrate(folder)


KINDS: dict[str, Callable[[Path], None]] = {
    "RAW brackets": _captured,
    "JPEG brackets": partial(_captured, rig="toy-ldr"),
    "JPEG singles": _singles,
    "frames of a video": _video,
    "calibrated before": _calibrated,
    "one view": partial(_captured, frames=1, cameras=1),
    "black": partial(_captured, light=0.0),
    "saturated": partial(_captured, light=1e5),
    "damaged file": _damaged,
    "missing file": _missing,
}
"""Functions that make a session of a kind in a folder that is not there yet."""
