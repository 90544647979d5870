"""Scatter of light in each lens, measured by dark scene points as the surroundings of their images change.

A dark point has one light of its own. The light that it gains where its picture lies nearer to lamps is
veiling glare: `E = (1 - share) L + share halo`, the halo being that of the picture itself
(`recon.observe.glare`). Points are eliminated; there remains a linear problem of one number a camera. A black
level that is off by as much in all views is no part of it.
"""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import map_coordinates

from imaging.arrays import Array, Integers, Mask
from imaging.robust import huber_weight, robust_scale
from imaging.session.records import Rung
from recon.data.dataset import MOST_TRACKED, Dataset
from recon.data.geometry import project
from recon.data.light import Images
from recon.observe.glare import spread
from recon.splat.torch_threads import torch_on_one_thread

DARK = 0.1
"""Most light of a point, relative to that of its halo: brighter points differ by their gloss."""
LEAST = 0.002
"""Share of the light below which glare is left to be."""
NOISE, SHIFT = 0.02, 0.3
"""Standard deviations of samples at a point: a share of its light, and a displacement in px."""
UNSURE = 0.2
"""Largest share of a halo that may come from clipped light, which is a lower bound."""
FEWEST_VIEWS, FEWEST_POINTS = 5, 30
NAME = "refine glare"
FOLDS, ROUNDS, HUBER = 5, 10, 1.5
UNIT = "ln(1 + r^2) per held-out point, r in standard deviations"
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, eq=False)
class DarkObservations:
    """Observations of dark points [N] by cameras [N]: light and halo [N] there, and the standard deviation of
    the light by noise and displacement.
    """

    point: Integers
    camera: Integers
    light: Array
    halo: Array

    def part(self, keep: Mask) -> "DarkObservations":
        """The observations that `keep` [N] names."""
        return DarkObservations(self.point[keep], self.camera[keep], self.light[keep], self.halo[keep])


def glare_of(dataset: Dataset, images: Images) -> tuple[list[float], Rung]:
    """The share that each camera of the training views scatters, in order of the views; and why.

    images: radiance images of the training views. The rung is taken where held-out points ask for it and the
    share is no smaller than `LEAST`.
    """
    cameras = list(dict.fromkeys(view.camera for view in dataset.train))
    nothing = [0.0] * len(cameras)
    if dataset.bands:
        return nothing, Rung(name=NAME, taken=False, reason="views of one band each are not compared")
    observations = dark_observations(dataset, images, cameras)
    points, fold = np.unique(observations.point, return_inverse=True)
    if len(points) < FEWEST_POINTS:
        reason = f"fewer than {FEWEST_POINTS} dark scene points are seen by {FEWEST_VIEWS} training views"
        return nothing, Rung(name=NAME, taken=False, reason=reason)
    gains = np.concatenate(
        [_gains(observations, fold % FOLDS == held, len(cameras)) for held in range(FOLDS)]
    )
    shares = _solved(observations, len(cameras)).clip(0.0).tolist()
    share = float(np.median(shares))
    what = f"{len(points)} dark scene points show that {100 * share:.2g} % of the light is scattered"
    error = float(gains.std(ddof=1) / np.sqrt(len(gains)))
    rung = Rung.judged(NAME, float(gains.mean()), error, UNIT, what, len(cameras))
    return shares, rung.model_copy(update={"taken": rung.taken and share >= LEAST})


@torch_on_one_thread()
def dark_observations(dataset: Dataset, images: Images, cameras: list[str]) -> DarkObservations:
    """Every training view at every dark point that calibration saw in it; cameras: as they are numbered."""
    xyz, tracks = dataset.tracks(MOST_TRACKED)
    light, halo, slope = np.full((3, len(dataset.train), len(xyz)), np.nan)
    for row, (view, (rgb, trusted)) in enumerate(zip(dataset.train, images, strict=True)):
        points = tracks.get(view.id.image_name)
        if points is None:
            continue
        bright, usable = rgb @ _LUMINANCE, trusted & view.valid
        stack = torch.from_numpy(np.stack([bright, np.where(usable, 0.0, bright)], axis=-1))
        around, unsure = spread(stack).numpy().transpose(2, 0, 1)
        pixels, depth = project(view.lens, xyz[points])
        at = pixels.T[::-1] - 0.5
        bright_there, halo_there = (
            map_coordinates(np.where(valid, values, np.nan), at, order=1, cval=np.nan)
            for values, valid in ((bright, usable), (around, unsure < UNSURE * around))
        )
        steep = map_coordinates(np.hypot(*np.gradient(bright)), at, order=1, cval=np.nan)
        good = (depth > 0) & np.isfinite(bright_there) & np.isfinite(halo_there) & np.isfinite(steep)
        for table, values in ((light, bright_there), (halo, halo_there), (slope, steep)):
            table[row, points[good]] = values[good]
    often = np.flatnonzero(np.isfinite(light).sum(0) >= FEWEST_VIEWS)
    light, halo, slope = light[:, often], halo[:, often], slope[:, often]
    middle = np.nanmean(light, axis=0)
    dark = (middle > 0) & (middle < DARK * np.nanmean(halo, axis=0))
    unit = np.hypot(NOISE * middle, SHIFT * np.nanmedian(slope, axis=0))[dark]
    light, halo = light[:, dark] / unit, halo[:, dark] / unit
    view_of, point = np.nonzero(np.isfinite(light))
    numbers = np.array([cameras.index(view.camera) for view in dataset.train])
    return DarkObservations(point, numbers[view_of], light[view_of, point], halo[view_of, point])


def _gains(observations: DarkObservations, held: Mask, cameras: int) -> Array:
    """Gains in the prediction of each held-out point with the shares from the other points."""
    shares, test = _solved(observations.part(~held), cameras), observations.part(held)
    after = _residual(test, shares)
    scale = max(robust_scale(after), 1e-6)
    # As if errors were of a Cauchy distribution: where something stands before a point, it shows nothing.
    less = [np.log1p((one / scale) ** 2) for one in (_residual(test, np.zeros(cameras)), after)]
    counts_of = np.bincount(test.point)
    return np.asarray((np.bincount(test.point, less[0] - less[1]) / np.maximum(counts_of, 1))[counts_of > 0])


def _solved(observations: DarkObservations, cameras: int) -> Array:
    """The shares, by robust least squares in what observations of a point differ by."""
    columns = np.zeros((len(observations.light), cameras))
    columns[np.arange(len(observations.light)), observations.camera] = observations.halo
    weight, shares = np.ones(len(observations.light)), np.zeros(cameras)
    for _ in range(ROUNDS):
        slopes = columns - _mean(observations.point, columns, weight)
        light = observations.light - _mean(observations.point, observations.light[:, None], weight)[:, 0]
        normal = slopes.T @ (weight[:, None] * slopes)
        shares = np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ (slopes.T @ (weight * light))
        residuals = light - slopes @ shares
        weight = huber_weight(residuals, HUBER * max(robust_scale(residuals), 1e-6))
    return np.asarray(shares)


def _residual(observations: DarkObservations, shares: Array) -> Array:
    """Return what the shares leave unexplained between the observations of each point, [N]."""
    unexplained = (observations.light - shares[observations.camera] * observations.halo)[:, None]
    return np.asarray((unexplained - _mean(observations.point, unexplained, np.ones(len(unexplained))))[:, 0])


def _mean(point: Integers, values: Array, weight: Array) -> Array:
    """Weighted means of the observations [N, C] of each point, at each observation."""
    total = np.maximum(np.bincount(point, weight), 1e-12)
    return np.stack([(np.bincount(point, weight * column) / total)[point] for column in values.T], axis=1)
