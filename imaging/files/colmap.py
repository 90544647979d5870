"""The one place that imports pycolmap: safely, quietly, and with a reader of its sparse models."""

# pycolmap 4.2's shared object interposes the system's zlib; unless zlib was loaded before it, the
# next compression anywhere in the process aborts.
from imaging.arrays import Array, Integers

import zlib  # noqa: F401  # isort: skip
import signal
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap as pycolmap

from imaging.errors import InputError

pycolmap.logging.minloglevel = 2
pycolmap.logging.logtostderr = True
if threading.current_thread() is threading.main_thread():
    # glog answers SIGTERM with a stack trace; the earlier handler has to stay.
    _handler = signal.getsignal(signal.SIGTERM)
    signal.signal(signal.SIGTERM, signal.SIG_DFL if _handler is None else _handler)


@dataclass(frozen=True)
class SparsePoints:
    """Scene points of a COLMAP model.

    xyz: float64 [P, 3], world; error: float64 [P], px, mean reprojection error;
    views: int64 [P], track length.
    """

    xyz: Array
    error: Array
    views: Integers


def read_points(folder: Path) -> SparsePoints:
    """The points of the COLMAP model in `folder`; InputError if it cannot be read."""
    model = read_model(folder)
    points = [model.points3D[key] for key in sorted(model.points3D)]
    return SparsePoints(
        xyz=np.array([point.xyz for point in points], np.float64).reshape(-1, 3),
        error=np.array([point.error for point in points], np.float64),
        views=np.array([point.track.length() for point in points], np.int64),
    )


def read_tracks(folder: Path) -> tuple[Array, dict[str, Integers]]:
    """Scene points [P, 3] of a COLMAP model, and which of them each image saw, by its name: rows [K].

    InputError if it cannot be read.
    """
    model = read_model(folder)
    keys = sorted(model.points3D)
    xyz = np.array([model.points3D[key].xyz for key in keys], np.float64).reshape(-1, 3)
    places: dict[int, set[int]] = {number: set() for number in model.images}
    for place, key in enumerate(keys):
        for element in model.points3D[key].track.elements:
            places[element.image_id].add(place)
    return xyz, {
        model.images[number].name: np.array(sorted(rows), np.int64) for number, rows in places.items()
    }


def read_model(folder: Path) -> pycolmap.Reconstruction:
    """The whole COLMAP model in `folder`; InputError if it cannot be read."""
    try:
        return pycolmap.Reconstruction(str(folder))
    except (ValueError, RuntimeError, OSError) as error:
        raise InputError(f"{folder} is not a COLMAP model: run `rig calibrate` again.") from error
