"""Distances between the views of a panorama, and the axes of its map: level, as the pictures were held."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from imaging.arrays import Array
from imaging.errors import InputError
from imaging.files.colmap import read_points
from imaging.files.photo import read_metadata
from imaging.optics.pose import as_held, upwards
from imaging.session.calibration import ViewCalibration
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def parallax_of(session: Path, views: Sequence[ViewCalibration]) -> tuple[float, float | None]:
    """Distance between views at most, and the degrees by which that moves a point at the median distance.

    0 degrees where they differ by rounding in float64 alone; None where there are no scene points.
    """
    motions = [view.cam_from_world.matrix() for view in views]
    centres: Array = np.array([-motion[:3, :3].T @ motion[:3, 3] for motion in motions])
    middle = centres.mean(axis=0)
    apart = 2 * float(np.linalg.norm(centres - middle, axis=1).max())
    if apart <= 1e-9 * (1 + float(np.abs(centres).max())):
        return apart, 0.0
    colmap = session / "calibration" / "colmap"
    points = read_points(colmap).xyz if colmap.is_dir() else np.empty((0, 3))
    if not len(points):
        return apart, None
    return apart, float(np.degrees(apart / np.median(np.linalg.norm(points - middle, axis=1))))


def upright_motion(session: Session, view: ViewCalibration, shots: Sequence[ShotRecord]) -> Array:
    """Motion of a view into the axes of its upright picture, as far as its file states how it was held."""
    try:
        orientation = read_metadata(session.file(shots[0])).orientation
    except InputError:  # no header that can be read
        orientation = 1
    return as_held(view.cam_from_world.matrix(), orientation)


def map_axes(motions: Sequence[Array]) -> Array:
    """Axes of the map in the world, as rows: level, with its middle where the first view looks."""
    up = upwards(motions)
    side = np.cross(up, motions[0][2, :3])
    if np.linalg.norm(side) < 1e-3:  # it looks straight up or down
        side = -motions[0][0, :3] - (-motions[0][0, :3] @ up) * up
    side /= np.linalg.norm(side)
    return np.stack([side, up, np.cross(side, up)])
