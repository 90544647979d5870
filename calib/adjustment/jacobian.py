"""Jacobian of a COLMAP model's residuals with respect to its poses, its lenses and its points."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from calib.adjustment.bundle_adjustment import Free, is_fisheye, opencv_parameters
from calib.adjustment.observations import observations
from imaging.arrays import Array, Integers
from imaging.files.colmap import pycolmap

TERMS = 8
"""Numbers of a lens: `Lens.terms`."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Linearisation of N observations of M points, with P parameters of cameras; rows alternate x and y of an
    observation.

    residual, and seen: where: px [N, 2]. cameras: sparse [2N, P]. points: [N, 2, 3], by its own point. owner:
    of each observation the point [N], in order of COLMAP's numbers. image: COLMAP's number [N]. frames,
    sensors, lenses: where the 6 or 8 columns of a frame, of a sensor in its rig, and of a camera begin; poses
    move by a rotation vector and a shift in their own coordinates, lenses by `Lens.terms`. What stays has no
    column.
    """

    residual: Array
    observed: Array
    cameras: Any
    points: Array
    owner: Integers
    image: Integers
    frames: dict[int, int]
    sensors: dict[int, int]
    lenses: dict[int, int]


def linearise(reconstruction: Any, free: Free) -> Linear:
    """Linearise at the model's own values."""
    frames: dict[int, int] = {}
    sensors: dict[int, int] = {}
    lenses: dict[int, int] = {}
    width = 0
    # Columns: six for each frame and mounted camera that may move, then the terms of lenses that are free.
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        moved = [(frames, image.frame_id, 6)]
        if not is_reference(reconstruction, image) and image.camera_id not in free.placed:
            moved.append((sensors, image.camera_id, 6))
        if image.camera_id not in free.fixed:
            moved.append((lenses, image.camera_id, TERMS))
        for columns, number, count in moved:
            if number not in columns:
                columns[number] = width
                width += count
    # Rows: two for each observation, image by image, so that each block has one camera and one frame.
    table = observations(reconstruction)
    blocks: list[Any] = []
    parts: list[tuple[Array, Array]] = []
    for index, rows in table.of_images():
        image = reconstruction.image(index)
        world = table.world[table.point[rows]]
        cam, rig = image.cam_from_world().matrix(), image.frame.rig_from_world.matrix()
        local, held = world @ cam[:, :3].T + cam[:, 3], world @ rig[:, :3].T + rig[:, 3]
        camera = reconstruction.cameras[image.camera_id]
        projection = _fisheye if is_fisheye(camera) else _projection
        projected, by_ray, by_lens = projection(local, opencv_parameters(camera))
        terms = [(frames[image.frame_id], by_ray @ (cam[:, :3] @ rig[:, :3].T) @ _motion(held))]
        if image.camera_id in sensors and not is_reference(reconstruction, image):
            terms.append((sensors[image.camera_id], by_ray @ _motion(local)))
        if image.camera_id in lenses:
            terms.append((lenses[image.camera_id], _tied(by_lens, free)))
        blocks.append(_sparse(terms, width))
        parts.append((projected - table.observed[rows], by_ray @ cam[:, :3]))
    residuals, points = zip(*parts, strict=True)
    return Linear(
        np.concatenate(residuals),
        table.observed,
        sparse.vstack(blocks).tocsr(),
        np.concatenate(points),
        table.point,
        table.image,
        frames,
        sensors,
        lenses,
    )


def _sparse(blocks: list[tuple[int, Array]], width: int) -> Any:
    """Blocks [N, 2, .] that begin at given columns, as a sparse matrix [2N, width]."""
    data = np.concatenate([block for _, block in blocks], axis=2).reshape(-1)
    columns = np.concatenate([at + np.arange(block.shape[2]) for at, block in blocks])
    rows = len(data) // len(columns)
    starts = len(columns) * np.arange(rows + 1)
    return sparse.csr_matrix((data, np.tile(columns, rows), starts), shape=(rows, width))


def is_reference(reconstruction: Any, image: Any) -> bool:
    """Return whether an image's camera is the reference of its rig."""
    sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, image.camera_id)
    return bool(reconstruction.rigs[image.frame.rig_id].is_ref_sensor(sensor))


def _motion(points: Array) -> Array:
    """Return how points move with a rotation vector and a shift, [N, 3, 6]."""
    x, y, z = points.T
    none, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        [none, z, -y, one, none, none],
        [-z, none, x, none, one, none],
        [y, -x, none, none, none, one],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _tied(by_lens: Array, free: Free) -> Array:
    """One focal length for both axes unless the model has two: it is column 0, and column 1 is its copy."""
    if free.model in ("OPENCV", "OPENCV_FISHEYE"):
        return by_lens
    tied = by_lens.copy()
    tied[:, :, 0] += by_lens[:, :, 1]
    tied[:, :, 1] = 0.0
    return tied


def _projection(local: Array, terms: list[float]) -> tuple[Array, Array, Array]:
    """Pixels [N, 2] of points in a camera, and their derivatives by the points and by the terms."""
    fx, fy, cx, cy, k1, k2, p1, p2 = terms
    x, y, z = local.T
    u, v = x / z, y / z
    square = u * u + v * v
    radial, slope = 1 + square * (k1 + k2 * square), k1 + 2 * k2 * square
    bent_u = u * radial + 2 * p1 * u * v + p2 * (square + 2 * u * u)
    bent_v = v * radial + p1 * (square + 2 * v * v) + 2 * p2 * u * v
    uu = radial + 2 * u * u * slope + 2 * p1 * v + 6 * p2 * u
    uv = 2 * u * v * slope + 2 * p1 * u + 2 * p2 * v
    vv = radial + 2 * v * v * slope + 6 * p1 * v + 2 * p2 * u
    none, one = np.zeros_like(u), np.ones_like(u)
    bend = np.moveaxis(np.array([[fx * uu, fx * uv], [fy * uv, fy * vv]]), -1, 0)
    ray = np.moveaxis(np.array([[1 / z, none, -u / z], [none, 1 / z, -v / z]]), -1, 0)
    across = [bent_u, none, one, none, u * square, u * square**2, 2 * u * v, square + 2 * u * u]
    down = [none, bent_v, none, one, v * square, v * square**2, square + 2 * v * v, 2 * u * v]
    by_lens = np.moveaxis(np.array([across, down]), -1, 0)
    by_lens[:, :, 4:] *= np.array([fx, fy])[None, :, None]
    return np.stack([fx * bent_u + cx, fy * bent_v + cy], axis=1), bend @ ray, by_lens


def _fisheye(local: Array, terms: list[float]) -> tuple[Array, Array, Array]:
    """The same for a fisheye."""
    fx, fy, cx, cy, *ks = terms
    x, y, z = local.T
    side = np.maximum(np.hypot(x, y), 1e-12 * np.abs(z))
    across, down = x / side, y / side
    angle = np.arctan2(side, z)
    powers = angle[:, None] ** np.array([3, 5, 7, 9])
    bent = angle + powers @ ks
    rising = 1 + (powers / angle[:, None]) @ (np.array([3, 5, 7, 9]) * ks)
    square = side**2 + z**2
    # The radius in the image by the point, and what stays of a step aside.
    along = np.stack([across * z, down * z, -side], axis=1) * (rising / square)[:, None]
    wide = (bent / side)[:, None]
    aside = np.stack([1 - across**2, -across * down, 0 * x], axis=1) * wide
    below = np.stack([-across * down, 1 - down**2, 0 * x], axis=1) * wide
    by_ray = np.stack([fx * (across[:, None] * along + aside), fy * (down[:, None] * along + below)], axis=1)
    by_lens = np.zeros((len(x), 2, TERMS))
    by_lens[:, 0, 0], by_lens[:, 1, 1] = bent * across, bent * down
    by_lens[:, 0, 2] = by_lens[:, 1, 3] = 1.0
    by_lens[:, 0, 4:], by_lens[:, 1, 4:] = fx * across[:, None] * powers, fy * down[:, None] * powers
    pixels = np.stack([fx * bent * across + cx, fy * bent * down + cy], axis=1)
    return pixels, by_ray, by_lens
