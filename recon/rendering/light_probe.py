"""All light that arrives at a point, as a map of latitude and longitude: what lights things put there.

Six pictures, which together see everything, are averaged over each texel by solid angle, so that the light
of a lamp stays what it is however few texels it has. They are those of an equidistant fisheye: a Gaussian is
drawn as the ellipse that it is at its centre, which off the axis of a pinhole is too large, by more than half
of its light in the corner of a cube.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Array32
from recon.rendering.cameras.camera_paths import level_axes
from recon.result.scene import Scene
from recon.scene.environment import texels
from recon.splat import SplatCamera

FINER = 2.0
"""Pixels to a texel at the horizon."""
SAMPLES = 4
"""Along either side of a texel."""
_REACH = float(np.arccos(3**-0.5))
"""Angle from the axis of a picture to the corner of its sixth of all directions, radians."""
_BORDER = 2
"""Pixels by which a picture reaches beyond that, to be interpolated there."""
_FACES = tuple(
    np.array(axes, np.float64)
    for axes in (
        ((-1, 0, 0), (0, -1, 0), (0, 0, 1)),
        ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ((0, 0, 1), (0, -1, 0), (1, 0, 0)),
        ((0, 0, -1), (0, -1, 0), (-1, 0, 0)),
        ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
        ((-1, 0, 0), (0, 0, -1), (0, -1, 0)),
    )
)
"""Right, down and ahead of each picture along the axes of the map, which are right-handed as x, y, z."""


@dataclass(frozen=True, eq=False)
class LightProbe:
    """Map of the light at a place.

    light: linear radiance in the units of the calibration, float32 [rows, 2 * rows, C], premultiplied by
    alpha [rows, 2 * rows], which is None of a scene without. known: share of all directions from which the
    scene has light, 0..1; the rest is black. axes: float64 [3, 3], of longitude 90 degrees, of latitude 90
    degrees (the uppermost row), and of the middle of the map, in world axes, as of environment.exr.
    """

    light: Array32
    alpha: Array32 | None
    known: float
    axes: Array


def light_probe(scene: Scene, place: npt.ArrayLike, rows: int) -> LightProbe:
    """The light at a place [3] in the world of the calibration.

    The axes are those of the scene's environment, where it has one; else the middle is where the views look.
    """
    environment = scene.renderer.environment
    axes = level_axes(scene.views) if environment is None else environment.axes
    focal = FINER * rows / np.pi
    size = 2 * (int(np.ceil(focal * _REACH)) + _BORDER)
    pictures = []
    for face in _FACES:
        motion = np.eye(4)
        motion[:3, :3] = face @ axes
        motion[:3, 3] = -motion[:3, :3] @ np.asarray(place, np.float64)
        camera = SplatCamera(motion, focal, focal, size / 2, size / 2, size, size, fisheye=True)
        pictures.append(np.dstack(scene.covered_layer(camera)))
    averaged = _averaged(np.stack(pictures), focal, rows)
    light, alpha = np.ascontiguousarray(averaged[..., :-1]), averaged[..., -1]
    weight = np.sqrt(1 - np.square(texels(rows)[..., 1]))
    known = float((alpha * weight).sum() / weight.sum()) if environment is None else 1.0
    return LightProbe(light, alpha if scene.record.transparent else None, known, axes)


def _averaged(pictures: Array32, focal: float, rows: int) -> Array32:
    """Means of pictures [6, size, size, C] over the texels of a map by solid angle, [rows, 2 * rows, C]."""
    fine = texels(rows * SAMPLES)
    averaged = np.empty((rows, 2 * rows, pictures.shape[-1]), np.float32)
    for row in range(rows):
        lines = slice(row * SAMPLES, (row + 1) * SAMPLES)
        looked_up = _looked_up(pictures, focal, fine[lines])
        weight = np.sqrt(1 - np.square(fine[lines, 0, 1]))  # the cosine of the latitude
        mean = np.einsum("s,swc->wc", weight / weight.sum(), looked_up)
        averaged[row] = mean.reshape(2 * rows, SAMPLES, -1).mean(axis=1)
    return averaged


def _looked_up(pictures: Array32, focal: float, directions: Array) -> Array:
    """Pictures at directions [..., 3] along the axes of the map, bilinear, float64 [..., C]."""
    in_face = np.stack([directions @ face.T for face in _FACES])  # right, down and ahead of each face
    face = np.argmax(in_face[..., 2], axis=0)
    right, down, ahead = np.moveaxis(np.take_along_axis(in_face, face[None, ..., None], axis=0)[0], -1, 0)
    aside = np.hypot(right, down)
    scale = focal * np.arctan2(aside, ahead) / np.maximum(aside, 1e-12)
    x, y = (pictures.shape[1] / 2 + scale * part - 0.5 for part in (right, down))
    column, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    across, along = (x - column)[..., None], (y - row)[..., None]
    upper = pictures[face, row, column] * (1 - across) + pictures[face, row, column + 1] * across
    lower = pictures[face, row + 1, column] * (1 - across) + pictures[face, row + 1, column + 1] * across
    return np.asarray(upper * (1 - along) + lower * along)
