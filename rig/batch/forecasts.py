"""Memory forecast of each step of a plan, made before it begins."""

from pathlib import Path

from imaging.compute.workers import Task, Workers
from imaging.session.session import Session
from recon.decide.cost.memory_need import forecast
from recon.result.model import SPLATS
from rig.batch.batch_plan import PlannedScene

CALIBRATION = 420_000_000
"""Bytes of the process itself. With the next two the peaks of five sessions are met or exceeded."""
PIXEL = 80
"""Bytes of a pixel of the photograph that a calibration has in memory."""
VIEW = 8_000_000
"""Bytes that a calibration has of each view: features, matches, and their part of the adjustment."""
EXPORT = 600_000_000
"""Bytes of an export of a scene of next to nothing, in the format that takes most."""
SPLAT = 17
"""Bytes that an export has in memory for each byte of splats.ply."""


def calibration(session: Path) -> Task:
    """Forecast `rig calibrate`, by the largest photograph and the number of them. Errors: those of a
    session.
    """
    shots = Session.open(session).shots("scene")
    largest = max((shot.width * shot.height for shot in shots), default=0)
    views = {(shot.frame, shot.camera) for shot in shots}
    return Task(CALIBRATION + PIXEL * largest + VIEW * len(views))


def training(session: Path, scene: PlannedScene, workers: Workers) -> Task:
    """Forecast `rig reconstruct`. InputError: more than any machine has, with the setting that would fit."""
    return Task(forecast(session, workers.room, workers.cores, scene.request()), gpu=True)


def export(reconstruction: Path) -> Task:
    """Forecast `rig export`, by the size of the scene; a missing scene is reported by the command itself."""
    scene = reconstruction / SPLATS
    return Task(EXPORT + SPLAT * (scene.stat().st_size if scene.is_file() else 0))
