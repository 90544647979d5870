"""Albedo of a scene's Gaussians: their radiance over the irradiance of the scene's own light, with error.

Of a matte surface radiance is albedo times irradiance over pi, so that what a scene shows of a surface and of
all that lights it says how much the surface reflects, without a unit and without a guess of the light.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from imaging.arrays import Array, Integers, Mask
from imaging.errors import ReconstructionError
from imaging.progress import Progress, unreported
from recon.albedo.irradiance import Irradiance, irradiance_at
from recon.albedo.surface import SOLID, Planes, observations_of, planes_at
from recon.result.scene import Scene

PLACES = 800
"""Places at which irradiance is measured, at most; between them it is interpolated."""
NEAREST = 4
FEWEST_VIEWS = 2
"""Views that have to see a Gaussian: one says nothing of where it is."""
WORST = 0.5
"""Standard error of the logarithm beyond which an albedo is not stated."""
DARK = 1e-30
"""Irradiance, scene units, that counts as zero."""
MOST_UNSEEN = 0.5
"""Share of the directions above a surface, by cosine, beyond which nothing is stated. A room has a median
error of 0.070 with it, in 54 % of the pixels, and of 0.076 without, in 70 %; a yard, whose sun few views saw,
0.10 in 0.2 % and 0.28 in 28 % (`bench/output/albedo.py`)."""
_FILLED, _SMALL = 0.5, 0.25
"""Errors of the logarithm: of light that no view saw, and of that of small sources, by their shares."""
_ANY = 100.0
"""Variance of a logarithm of which nothing is known."""
_MODEL = 0.12
"""Error of the logarithm that remains on surfaces that are well seen."""


@dataclass(frozen=True, eq=False)
class Albedo:
    """Reflectance of N Gaussians, of the light of three channels; NaN where it is not known.

    albedo [N, 3], 0..1; irradiance [N, 3], in the unit of `Scene.render` times steradians; sigma [N]:
    standard error of the albedo, of the mean of its channels.
    """

    albedo: Array
    irradiance: Array
    sigma: Array

    @property
    def known(self) -> Mask:
        """Return which Gaussians have one."""
        return np.isfinite(self.sigma)

    def __str__(self) -> str:
        if not self.known.any():
            return "of no Gaussian, as views saw too little of the light that arrives"
        error = float(np.median(self.sigma[self.known]))
        return f"of {self.known.mean():.0%} of the Gaussians, standard error {error:.2g} in the median"


def albedo_of(scene: Scene, progress: Progress = unreported) -> Albedo:
    """Estimate the albedo of each Gaussian.

    Args:
        scene: Scene of linear light.
        progress: Callback.

    Returns:
        Albedo, irradiance and error; not a number where too much of the light comes from where no view
        looked, where what is seen changes with the direction, and of lamps.

    Raises:
        ReconstructionError: The scene has display values or bands, or no training view.
    """
    if scene.record.display is not None:
        raise ReconstructionError(
            f"{scene.folder} was trained on display values, which end at white, and lamps are above: leave "
            "--albedo out, or reconstruct it from RAW or from brackets."
        )
    if scene.record.bands:
        raise ReconstructionError(
            f"{scene.folder} has bands, and albedo is of red, green, blue: leave --albedo out."
        )
    if not any(view.use == "training" for view in scene.views):
        raise ReconstructionError(
            f"{scene.folder} has no training views, which say what of its light is known: leave --albedo out."
        )
    observed = observations_of(scene, progress)
    means = scene.gaussians.parameters["means"].detach().double().numpy()
    opacities = scene.gaussians.opacities().detach().double().numpy()
    trusted = observed.views >= FEWEST_VIEWS
    weights = np.where(trusted & (opacities >= SOLID), opacities, 0.0)
    nothing = np.full((len(means), 3), np.nan)
    if (weights > 0).sum() < 4:
        return Albedo(nothing, nothing.copy(), nothing[:, 0].copy())
    planes = planes_at(means, weights, observed.towards)
    cell, group = _cells(planes, weights > 0)
    points, normals, clearance = _places(planes, weights, group)
    arriving = irradiance_at(scene, points, normals, clearance, trusted, observed.sky, progress)
    ln_light, variance = _interpolated(planes, cell, points, normals, arriving)
    variance = variance + observed.spread**2 + _MODEL**2
    irradiance = np.exp(ln_light)
    albedo = np.pi * observed.light / irradiance
    sigma = np.sqrt(variance)
    grey = albedo.mean(1)
    shines = albedo.max(1) > np.exp(2 * sigma)  # more than all that arrives
    stated = trusted & (sigma < WORST) & ~shines & np.isfinite(grey)
    return Albedo(
        np.where(stated[:, None], np.minimum(albedo, 1), np.nan),
        np.where(stated[:, None], irradiance * scene.record.normaliser, np.nan),
        np.where(stated, sigma * np.minimum(grey, 1), np.nan),
    )


def _cells(planes: Planes, solid: Mask) -> tuple[float, Integers]:
    """Side of the cells that leave at most `PLACES` of them, and the cell of each point, -1 where not solid.

    A cell holds what is near and faces the same of six ways.
    """
    points, normals = planes.points[solid], planes.normals[solid]
    axis = np.abs(normals).argmax(1)
    facing = 2 * axis + (normals[np.arange(len(axis)), axis] > 0)
    side = max(float(np.quantile(np.ptp(points, axis=0), 1.0)) / 256, 1e-9)
    while True:
        keys = np.column_stack([np.floor(points / side).astype(np.int64), facing])
        cells, group = np.unique(keys, axis=0, return_inverse=True)
        if len(cells) <= PLACES:
            whole = np.full(len(solid), -1)
            whole[solid] = group.ravel()
            return side, whole
        side *= 1.15


def _places(planes: Planes, weights: Array, group: Integers) -> tuple[Array, Array, Array]:
    """Means of the cells: points and normals [M, 3], and how thick surfaces are there [M]."""
    inside = group >= 0
    count = int(group.max()) + 1

    def mean(values: Array) -> Array:
        total = np.bincount(group[inside], weights[inside], count)
        return np.asarray(np.bincount(group[inside], (weights * values)[inside], count) / total)

    points = np.stack([mean(planes.points[:, axis]) for axis in range(3)], 1)
    normals = np.stack([mean(planes.normals[:, axis]) for axis in range(3)], 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    return points, normals, 2 * mean(planes.thickness)


def _interpolated(
    planes: Planes, cell: float, points: Array, normals: Array, arriving: Irradiance
) -> tuple[Array, Array]:
    """ln of the irradiance [N, 3] at the points of planes, and its variance [N]; `_ANY`: not known."""
    turn = 2.0 * cell  # a place that faces 30 degrees aside is as far as the next cell
    tree = cKDTree(np.column_stack([points, turn * normals]))
    distance, near = tree.query(
        np.column_stack([planes.points, turn * planes.normals]), min(NEAREST, len(points))
    )
    distance, near = distance.reshape(len(planes.points), -1), near.reshape(len(planes.points), -1)
    weight = 1 / (distance**2 + (0.3 * cell) ** 2)
    weight /= weight.sum(1, keepdims=True)
    logs = np.log(np.maximum(arriving.light, DARK))[near]
    mean = np.einsum("nk,nkc->nc", weight, logs)
    grey = logs.mean(-1)
    differing = (weight * (grey - (weight * grey).sum(1, keepdims=True)) ** 2).sum(1)
    unseen = (weight * arriving.unseen[near]).sum(1)
    slope, small = ((weight * part[near]).sum(1) for part in (arriving.slope, arriving.small))
    tilted = np.minimum(slope, 2) * np.minimum(planes.tilt, 0.5)
    filled = (weight * arriving.filled[near]).sum(1)
    variance = differing + tilted**2 + (_FILLED * filled) ** 2 + (_SMALL * small) ** 2
    dark = (arriving.light.min(1) <= DARK)[near].any(1) | (unseen > MOST_UNSEEN)
    return mean, np.where(dark, _ANY, variance)
