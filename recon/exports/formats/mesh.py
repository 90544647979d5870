"""A mesh of what is opaque: the depths of all views fused to a truncated signed distance, and its zero.

Curless and Levoy 1996; marching cubes by scikit-image. Depth is the median along each ray
(`recon.rendering`), colours are linear radiance, float32, beside those that screens show. They are the
geometric mean of the views that see a place, away from edges in depth, where a lamp a thousand times
brighter would outshine what is beside it.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_erosion, distance_transform_edt, map_coordinates

from imaging.arrays import Array, Array32
from imaging.errors import InputError, ReconstructionError
from imaging.files import store
from recon.exports.formats.ply import vertex_comments
from recon.exports.formats.vertices import packed_vertices, shown
from recon.exports.job import Job, Written
from recon.exports.loss import floor_of
from recon.exports.target_coordinates import pinhole
from recon.result.data_layers import DataLayers
from recon.result.display import in_colour
from recon.result.model import SceneView
from recon.splat import SplatCamera

CELLS = 192
"""Along the longest side of the box that the surfaces are in."""
WIDEST = 480
"""Pixels across at which views are drawn, at most: a cell is a few of them."""
TRUNCATION = 4.0
"""Cells from a surface to which its distance counts."""
_SHARE = 0.01
"""Share of the points of surfaces left out of the box at each end of each axis."""
_LEAST_VIEWS = 2
"""Fewest views of a cell: the depth of one view alone may be anything."""
_POINTS = 4000
"""Points of each view that determine the box."""


def write(job: Job) -> Written:
    """Write the file, as a writer of `rig export`; InputError without scikit-image, ReconstructionError if
    nothing is opaque.
    """
    measure = _skimage()
    if not job.scene.views:
        raise ReconstructionError(
            f"{job.scene.folder} has no views, which a mesh is made from: export points."
        )
    pictures = []
    for done, view in enumerate(job.scene.views):
        job.progress("drawing depths", done, len(job.scene.views))
        pictures.append(_drawn(job, view))
    volume = _Volume.around(job, pictures)
    for done, picture in enumerate(pictures):
        job.progress("fusing depths", done, len(pictures))
        volume.add(picture)
    job.progress("finding the surface", 0, 0)
    # Behind a surface nothing is seen, and its end there is no surface: all neighbours have to be seen.
    visible = binary_erosion(volume.weight >= _LEAST_VIEWS, np.ones((3, 3, 3)))
    distance = volume.distance
    if not (visible & (distance < 0)).any():
        raise _nothing(job)
    try:
        places, faces, _, _ = measure.marching_cubes(distance, 0.0, mask=visible)
    except (ValueError, RuntimeError) as error:
        raise _nothing(job) from error
    colours = np.stack(
        [map_coordinates(plane, places.T, order=1, mode="nearest") for plane in volume.colours()], 1
    )
    points = volume.origin + places * volume.cell - job.scene.record.offset
    light = colours * job.factor
    packed = packed_vertices(points, shown(light), vertex_comments(job), light=light, faces=faces)
    store.write_bytes(job.out, packed)
    unit = "m" if job.place.metres else "units"
    return Written(
        [job.out],
        notes=(
            f"what is smaller than {volume.cell:.3g} {unit}, a cell of this mesh of {len(faces):,} triangles",
            "what is transparent, and how colours depend on the direction",
        ),
    )


@dataclass(frozen=True, eq=False)
class _Picture:
    """Image of a pinhole: radiance [H, W, 3], and depth along the axis [H, W], infinite for no surface."""

    camera: SplatCamera
    light: Array32
    depth: Array32


def _drawn(job: Job, view: SceneView) -> _Picture:
    camera = pinhole(view.splat_camera)
    if camera.width > WIDEST:
        camera = camera.resized(WIDEST)
    light = in_colour(job.scene.render(camera), job.scene.record.bands)
    return _Picture(camera, light, DataLayers(job.scene).depth(camera))


@dataclass(eq=False)
class _Volume:
    """Cells [X, Y, Z] at origin + cell * index: mean distances in truncations, views, their light."""

    origin: Array
    cell: float
    distance: Array32
    weight: Array32
    light: Array32
    """[X, Y, Z, 3], natural logarithm."""
    lit: Array32
    floor: float
    """The dimmest radiance that matters."""

    @classmethod
    def around(cls, job: Job, pictures: list[_Picture]) -> "_Volume":
        """Choose the volume that holds the visible surfaces, but for the outermost."""
        points = np.concatenate([_points(picture) for picture in pictures])
        if len(points) < 4:
            raise _nothing(job)
        low, high = np.quantile(points, [_SHARE, 1 - _SHARE], axis=0)
        cell = float((high - low).max()) / CELLS
        if not cell > 0:
            raise _nothing(job)
        margin = 2 * TRUNCATION * cell
        shape = np.ceil((high - low + 2 * margin) / cell).astype(int) + 1
        distance, weight, lit = (np.zeros(shape, np.float32) for _ in range(3))
        light = np.zeros((*shape, 3), np.float32)
        return cls(low - margin, cell, distance, weight, light, lit, floor_of(job.scene))

    def add(self, picture: _Picture) -> None:
        """Add a view to every cell that it sees, up to behind the surface."""
        camera, reach = picture.camera, TRUNCATION * self.cell
        with np.errstate(invalid="ignore"):  # of nothing but infinities
            smooth = np.ptp(sliding_window_view(np.pad(picture.depth, 1, "edge"), (3, 3)), (2, 3)) < reach
        ln_light = np.log(np.maximum(picture.light, self.floor))
        y, z = np.meshgrid(*(np.arange(size) for size in self.distance.shape[1:]), indexing="ij")
        turn, shift = camera.cam_from_world[:3, :3], camera.cam_from_world[:3, 3]
        plane = np.stack([np.zeros_like(y), y, z], -1) * self.cell + self.origin
        seen_from = (plane @ turn.T + shift).astype(np.float32)
        step = (turn[:, 0] * self.cell).astype(np.float32)
        for x in range(len(self.distance)):
            across, down, ahead = np.moveaxis(seen_from + x * step, -1, 0)
            front = np.maximum(ahead, 1e-9)
            column = np.floor(camera.fx * across / front + camera.cx)
            row = np.floor(camera.fy * down / front + camera.cy)
            inside = (
                (ahead > 0) & (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
            )
            rows, columns = row[inside].astype(int), column[inside].astype(int)
            away = picture.depth[rows, columns] - ahead[inside]
            seen_here = np.isfinite(away) & (away > -reach)
            where = np.flatnonzero(inside)[seen_here]
            value = (away[seen_here] / reach).clip(-1, 1)
            weight, distance = self.weight[x].reshape(-1), self.distance[x].reshape(-1)
            distance[where] += (value - distance[where]) / (weight[where] + 1)
            weight[where] += 1
            near = (np.abs(value) < 1) & smooth[rows[seen_here], columns[seen_here]]
            self.light[x].reshape(-1, 3)[where[near]] += ln_light[
                rows[seen_here][near], columns[seen_here][near]
            ]
            self.lit[x].reshape(-1)[where[near]] += 1

    def colours(self) -> list[Array32]:
        """Radiance of the cells, a volume for each of red, green and blue; unlit ones have that of others."""
        nearest = distance_transform_edt(self.lit == 0, return_distances=False, return_indices=True)
        means = np.exp(self.light / np.maximum(self.lit, 1)[..., None])[tuple(nearest)]
        return [np.asarray(means[..., channel], np.float32) for channel in range(3)]


def _points(picture: _Picture) -> Array:
    """Some places of surfaces in the world, [K, 3]."""
    rows, columns = np.nonzero(np.isfinite(picture.depth))
    some = np.linspace(0, len(rows) - 1, min(len(rows), _POINTS)).astype(int)
    rows, columns = rows[some], columns[some]
    camera, depth = picture.camera, picture.depth[rows, columns].astype(np.float64)
    x = (columns + 0.5 - camera.cx) / camera.fx
    y = (rows + 0.5 - camera.cy) / camera.fy
    in_camera = np.stack([x, y, np.ones_like(x)], -1) * depth[:, None]
    return np.asarray((in_camera - camera.cam_from_world[:3, 3]) @ camera.cam_from_world[:3, :3])


def _nothing(job: Job) -> ReconstructionError:
    return ReconstructionError(
        f"No surface of {job.scene.folder} is opaque in {_LEAST_VIEWS} views, so there is no mesh: export "
        "points."
    )


def _skimage() -> ModuleType:
    try:
        from skimage import measure
    except ImportError as error:
        raise InputError("A mesh needs scikit-image: run `pip install -e '.[mesh]'`.") from error
    return measure
