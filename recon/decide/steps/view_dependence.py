"""Gain in the prediction of scene points' light with dependence on the viewing direction.

Every scene point that many training views saw has as many samples. The luminance of each sample is predicted
from all the others: by their mean, and by harmonics of the direction fitted to them. No training is needed.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import map_coordinates, minimum_filter

from imaging.arrays import Array, Integers
from recon.data.dataset import MOST_TRACKED, Dataset
from recon.data.geometry import inside, project
from recon.data.light import Images, grey
from recon.scene.harmonics import DEGREE, basis
from recon.splat import SplatCamera

FEWEST_VIEWS = 8
"""Fewest views of a point: with fewer, harmonics are hardly constrained."""
FEWEST_POINTS = 50
MOST_POINTS = 2000
"""Most points, those that most views saw; more of them add nothing."""
RIDGE = 0.1
"""Variance of a look over that of a coefficient: how far the coefficients are trusted to be off zero."""
MOST_UNTRACKED = 5000
CELLS = 80
"""Across a picture, in which the nearest of points covers the others."""
BEHIND = 0.05
"""Largest distance, relative to its depth, of a point behind the nearest beside it that still counts as
visible.
"""
NOISE, SHIFT = 0.01, 0.3
"""Standard deviations of samples without any gloss: a share of the light, and a displacement in px."""
_LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True)
class Looks:
    """Samples of V views at P points: log luminance [V, P], NaN where unseen; unit directions from the camera
    to the point [V, P, 3]; gradient of log luminance a pixel [V, P].
    """

    light: Array
    towards: Array
    slope: Array


@dataclass(frozen=True)
class Gains:
    """Gains of degrees 1 and 2 over degree 0, dB: the means, and errors of the steps.

    db[d]: of degree d over 0, so db[0] is 0. error[low, high]: standard error of db[high] - db[low].
    """

    points: int
    db: Array
    error: Array


def looks(dataset: Dataset, images: Images, points: Array | None = None) -> Looks:
    """Sample every training view at every scene point that calibration saw in it; `images`: radiance
    images.

    points [P, 3]: other points with nothing but positions; some of them, evenly chosen, are sampled in the
    views in which they are not covered by others.
    """
    if points is None:
        xyz, tracks = dataset.tracks(MOST_TRACKED)
    else:
        xyz = points[:: 1 + len(points) // MOST_UNTRACKED]
        tracks = {view.id.image_name: uncovered(view.lens, points, xyz) for view in dataset.train}
    shape = len(dataset.train), len(xyz)
    light, slope = np.full(shape, np.nan), np.full(shape, np.nan)
    towards = np.zeros((*shape, 3))
    for row, (view, (rgb, trusted)) in enumerate(zip(dataset.train, images, strict=True)):
        rows_seen = tracks.get(view.id.image_name)
        if rows_seen is None:
            continue
        pixels, depth = project(view.lens, xyz[rows_seen])
        bright = rgb @ np.array(_LUMINANCE) if view.shots[0].band is None else grey(rgb)
        usable = trusted & view.valid & np.isfinite(bright) & (bright > 0)
        log = np.log(np.where(usable, bright, np.nan))
        x, y = pixels.T - 0.5
        near = [
            map_coordinates(log, [y + dy, x + dx], order=1, cval=np.nan)
            for dx, dy in ((0, 0), (0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5))
        ]
        good = (depth > 0) & np.isfinite(near).all(0)
        light[row, rows_seen[good]] = near[0][good]
        slope[row, rows_seen[good]] = np.hypot(near[1] - near[2], near[3] - near[4])[good]
        offset = xyz[rows_seen] - view.centre
        towards[row, rows_seen] = offset / np.linalg.norm(offset, axis=1, keepdims=True).clip(1e-12)
    return Looks(light, towards, slope)


def uncovered(lens: SplatCamera, points: Array, xyz: Array) -> Integers:
    """Visibility of `xyz` [Q, 3] in a camera: in its picture with none of `points` [P, 3] in front."""
    size = lens.width / CELLS
    shape = math.ceil(lens.height / size) + 1, CELLS + 1

    def cells(pixels: Array) -> tuple[Integers, Integers]:
        column, row = np.floor(pixels / size).astype(np.int64).T
        return row, column

    nearest = np.full(shape, np.inf)
    pixels, depth = project(lens, points)
    shown = inside(lens, pixels, depth)
    np.minimum.at(nearest, cells(pixels[shown]), depth[shown])
    nearest = minimum_filter(nearest, 3)
    pixels, depth = project(lens, xyz)
    rows = np.flatnonzero(inside(lens, pixels, depth))
    return np.asarray(rows[depth[rows] <= (1 + BEHIND) * nearest[cells(pixels[rows])]], np.int64)


def gains(looks: Looks) -> Gains | None:
    """Return what each degree gains; None if fewer than 50 points are seen by 8 views or more.

    Points count by how little noise and a misplaced look would change them; errors are over points.
    """
    views = np.isfinite(looks.light).sum(0)
    chosen = np.argsort(-views, kind="stable")[:MOST_POINTS]
    chosen = chosen[views[chosen] >= FEWEST_VIEWS]
    if len(chosen) < FEWEST_POINTS:
        return None
    light, towards = looks.light[:, chosen].T, looks.towards[:, chosen].transpose(1, 0, 2)
    slope = np.nanmedian(looks.slope[:, chosen], axis=0)
    weight = 1 / (NOISE**2 + (SHIFT * slope) ** 2)
    missed = weight * np.stack([_missed(light, towards, degree) for degree in range(DEGREE + 1)])
    total = missed.sum(1).clip(1e-30)
    db = 10 * np.log10(total[0] / total)
    share = 10 / np.log(10) * missed / total[:, None]
    error = np.linalg.norm(share[:, None] - share[None], axis=-1)
    return Gains(len(chosen), db, error)


def _missed(light: Array, towards: Array, degree: int) -> Array:
    """Mean square [P] of what looks [P, V] differ from what all others of their point predict.

    Ridge regression, its constant free; a look is left out in closed form: residual over one minus leverage.
    """
    there = np.isfinite(light)
    count = there.sum(1, keepdims=True)
    values = basis(torch.from_numpy(towards.reshape(-1, 3)), degree).numpy()[:, 1:]
    terms = np.where(there[..., None], values.reshape(*light.shape, -1), 0.0)
    terms = np.where(there[..., None], terms - terms.sum(1, keepdims=True) / count[..., None], 0.0)
    centred = np.where(there, light - np.nansum(light, axis=1, keepdims=True) / count, 0.0)
    inner = np.einsum("pvk,pvl->pkl", terms, terms) + RIDGE * np.eye(terms.shape[-1])
    solved = np.linalg.solve(inner, terms.transpose(0, 2, 1))
    predicted = np.einsum("pvk,pk->pv", terms, np.einsum("pkv,pv->pk", solved, centred))
    leverage = np.einsum("pvk,pkv->pv", terms, solved) + 1 / count
    residuals = np.where(there, (centred - predicted) / np.maximum(1 - leverage, 1e-9), 0.0)
    return np.asarray((residuals**2).sum(1) / count[:, 0])
