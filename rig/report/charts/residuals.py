"""Residuals of every scene point, from the COLMAP model of a calibration."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.session.view_id import ViewId

MOST_OBSERVATIONS = 200_000
"""Most observations drawn; of larger models an even choice of each image's observations is."""


@dataclass(frozen=True, eq=False)
class CameraResiduals:
    """One camera's. size: width and height of its pictures, px; observed, miss: float64 [N, 2], px, where
    points were observed, and observed less projected."""

    size: tuple[int, int]
    observed: Array
    miss: Array

    @property
    def rms(self) -> float:
        """Root mean square of the lengths, px."""
        return float(np.sqrt((self.miss**2).sum(1).mean()))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals by camera; views: root mean square of the lengths, px."""

    cameras: dict[str, CameraResiduals]
    views: dict[ViewId, float]


def read_residuals(folder: Path) -> Residuals:
    """Read the images called `<camera>/<frame>.png` of the model in `folder`; empty without a model."""
    try:
        model = pycolmap.Reconstruction(str(folder))
    except (ValueError, RuntimeError, OSError):
        return Residuals({}, {})
    total = model.compute_num_observations()
    step = max(1, -(-total // MOST_OBSERVATIONS))
    sizes: dict[str, tuple[int, int]] = {}
    places_of: dict[str, list[Array]] = {}
    miss: dict[str, list[Array]] = {}
    views = {}
    for image in model.images.values():
        view = _view(image.name)
        if view is None or not image.has_pose:
            continue
        points = [point for point in image.points2D if point.has_point3D()][::step]
        if not points:
            continue
        places = np.array([point.xy for point in points], np.float64)
        xyz = np.array([model.points3D[point.point3D_id].xyz for point in points], np.float64)
        pose = image.cam_from_world().matrix()
        camera = model.cameras[image.camera_id]
        apart = places - np.asarray(camera.img_from_cam(xyz @ pose[:, :3].T + pose[:, 3]), np.float64)
        good = np.isfinite(apart).all(1)
        if not good.any():
            continue
        sizes[view.camera] = (camera.width, camera.height)
        places_of.setdefault(view.camera, []).append(places[good])
        miss.setdefault(view.camera, []).append(apart[good])
        views[view] = float(np.sqrt((apart[good] ** 2).sum(1).mean()))
    return Residuals(
        {
            name: CameraResiduals(sizes[name], np.concatenate(places_of[name]), np.concatenate(miss[name]))
            for name in sorted(sizes)
        },
        dict(sorted(views.items())),
    )


def _view(image: str) -> ViewId | None:
    """The view of an image's name; None for a name that is not one of ours."""
    try:
        return ViewId.of_image(image)
    except ValueError:
        return None
