"""A falloff and a gain of each camera, fitted to points that several views see.

A scene point is as bright in every view (away from gloss), so what differs between the views of its
track is the lens and the camera: `ln E = ln L_point + ln gain_camera + ln V(r)`. Points are eliminated by
taking each track's mean away; what is left is a small robust least-squares problem (Goldman, "Vignette
and exposure calibration and compensation", 2010, gives the model). A lens never gets brighter away from its
middle, so V does not rise anywhere; what rises is the scene.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from imaging.arrays import Array, Integers, Mask
from imaging.robust import huber_loss, huber_weight, robust_scale

ROUNDS = 30
SETTLED = 1e-4
"""Change of every number, absolute, at which a fit has come to its end."""
HALVINGS = 12
"""Halvings of a step before it is given up."""
HUBER = 1.5
"""Residuals beyond this many standard deviations count linearly: gloss, occlusion, wrong matches."""
DARKEST = 0.05
"""Share of the light of the middle that a lens leaves at least; what is darker is a hood, or no picture."""
RADII = np.linspace(0.0, 1.0, 41)
"""Radii at which a falloff has to be above that."""
FROM_SLOPES = np.array([[1.0, -1.0, 1 / 3], [0.0, 1.0, -2 / 3], [0.0, 0.0, 1 / 3]])
"""Coefficients of r^2, r^4, r^6 of a falloff whose slope over r^2 is a parabola with these ends and, between
them, this control point (Bernstein's form): it falls everywhere where none of the three is positive."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Brightness of scene points in the views that see them; rows are observations.

    point: int [N], which scene point; camera: int [N]; radius: float64 [N], 1 at the corner of the
    image; brightness: float64 [N], natural log of merged luminance; direction: float64 [N, 3], unit, from the
    point to the camera; region: int [N], the region of the scene that the point lies in.
    """

    point: Integers
    camera: Integers
    radius: Array
    brightness: Array
    direction: Array
    region: Integers

    def apart(self, groups: Sequence[int]) -> "Tracks":
        """Split the points by the group of the cameras, as many as `camera` counts, that see them: those that
        look through different filters see different light.
        """
        group = np.array(groups, np.int64)[self.camera]
        return replace(self, point=self.point * (max(groups, default=0) + 1) + group)

    def part(self, keep: Mask) -> "Tracks":
        """The observations that `keep` [N] names."""
        return Tracks(
            self.point[keep],
            self.camera[keep],
            self.radius[keep],
            self.brightness[keep],
            self.direction[keep],
            self.region[keep],
        )


@dataclass(frozen=True)
class Terms:
    """Terms of a fit: a falloff for each group of cameras, a gain for each camera."""

    lenses: tuple[int, ...]
    """Group of each camera; empty: no falloff."""
    gains: bool

    def parameters(self, cameras: int) -> int:
        """Numbers that are fitted; the mean of the gains is not one."""
        return 3 * len(set(self.lenses)) + (cameras - 1) * self.gains


@dataclass(frozen=True, eq=False)
class Fit:
    """polynomials: float64 [G, 3], of each group; log_gain: float64 [cameras]; scale: of the residuals."""

    polynomials: Array
    log_gain: Array
    scale: float


def track_losses(tracks: Tracks, fit: Fit, terms: Terms, scale: float) -> Array:
    """Mean Huber loss of each track under a fit."""
    residual = _residual(tracks, fit, terms)
    _, track = np.unique(tracks.point, return_inverse=True)
    loss = huber_loss(demeaned(residual[:, None], np.ones(len(residual)), track)[:, 0] / scale, HUBER)
    return np.asarray(np.bincount(track, loss) / np.bincount(track))


def fit_terms(tracks: Tracks, terms: Terms, cameras: int) -> Fit:
    """Gauss-Newton on the slopes, re-weighted by Huber's function; no step that makes the fit worse.

    No slope becomes positive. Steep falloff bends ln V so much that whole steps lead across zero, where there
    is no logarithm.
    """
    lenses = max(terms.lenses, default=-1) + 1
    fit = Fit(np.zeros((lenses, 3)), np.zeros(cameras), 1.0)
    _, track = np.unique(tracks.point, return_inverse=True)
    weight = np.ones(len(track))
    powers = radial_powers(tracks.radius) @ FROM_SLOPES.T
    lens = np.array(terms.lenses or [0] * cameras)[tracks.camera]
    for _ in range(ROUNDS):
        residual = demeaned(_residual(tracks, fit, terms)[:, None], weight, track)[:, 0]
        scale = max(robust_scale(residual), 1e-6)
        weight = huber_weight(residual, HUBER * scale)
        columns = []
        if lenses:
            slope = powers / _falloff(tracks, fit, terms)[:, None]
            columns += [np.where((lens == g)[:, None], slope, 0.0) for g in range(lenses)]
        if terms.gains:
            columns.append((tracks.camera[:, None] == np.arange(cameras)).astype(np.float64))
        if not columns:
            return Fit(fit.polynomials, fit.log_gain, scale)
        design = demeaned(np.concatenate(columns, axis=1), weight, track)
        residual = demeaned(_residual(tracks, fit, terms)[:, None], weight, track)[:, 0]
        normal = design.T @ (design * weight[:, None])
        # A trace of ridge settles the gauge of the gains and what the radii seen leave open.
        normal += 1e-9 * max(float(np.trace(normal)), 1e-12) * np.eye(len(normal))
        step = _falling(normal, design.T @ (weight * residual), fit.polynomials)
        taken = _stepped(tracks, replace(fit, scale=scale), terms, step, weight, track)
        if taken is None:
            return replace(fit, scale=scale)
        fit = taken
        if np.abs(step).max() < SETTLED:
            break
    return fit


def _falling(normal: Array, right: Array, polynomials: Array) -> Array:
    """The step that solves `normal @ step = right` as nearly as falloffs that rise nowhere can.

    Slopes of all polynomials [G, 3] come first, gains follow.
    """
    room = np.full(len(right), np.inf)
    room[: polynomials.size] = np.maximum(-(polynomials @ np.linalg.inv(FROM_SLOPES)).ravel(), 1e-12)
    root = np.linalg.cholesky(normal)
    bounds = np.full(len(right), -np.inf), room
    return np.asarray(optimize.lsq_linear(root.T, np.linalg.solve(root, right), bounds, "bvls").x)


def _stepped(
    tracks: Tracks, fit: Fit, terms: Terms, step: Array, weight: Array, track: Integers
) -> Fit | None:
    """The fit after a step that is halved until it does no harm; None if it always does."""

    def cost(one: Fit) -> float:
        return float(
            (weight * demeaned(_residual(tracks, one, terms)[:, None], weight, track)[:, 0] ** 2).sum()
        )

    numbers, before = fit.polynomials.size, cost(fit)
    for halving in range(HALVINGS):
        part = step * 0.5**halving
        polynomials = fit.polynomials + part[:numbers].reshape(fit.polynomials.shape) @ FROM_SLOPES
        if darkest(polynomials) < DARKEST:
            continue
        log_gain = fit.log_gain + (part[numbers:] if terms.gains else 0.0)
        trial = Fit(polynomials, log_gain - log_gain.mean(), fit.scale)
        if cost(trial) <= before:
            return trial
    return None


def darkest(polynomials: Array) -> float:
    """Least light that falloffs [G, 3] leave at any radius, of the middle."""
    return float((1.0 + polynomials @ radial_powers(RADII).T).min(initial=1.0))


def log_light(fit: Fit, terms: Terms) -> Array:
    """Natural log of what each camera leaves of the light at each of `RADII`, [cameras, R], in the mean 0."""
    light = np.repeat(fit.log_gain[:, None], len(RADII), axis=1)
    if terms.lenses:
        light += np.log(1.0 + fit.polynomials[np.array(terms.lenses)] @ radial_powers(RADII).T)
    return np.asarray(light - light.mean())


def _falloff(tracks: Tracks, fit: Fit, terms: Terms) -> Array:
    if not terms.lenses:
        return np.ones(len(tracks.radius))
    polynomials = fit.polynomials[np.array(terms.lenses)[tracks.camera]]
    return light_left(polynomials, tracks.radius)


def _residual(tracks: Tracks, fit: Fit, terms: Terms) -> Array:
    return np.asarray(tracks.brightness - np.log(_falloff(tracks, fit, terms)) - fit.log_gain[tracks.camera])


def radial_powers(radius: Array) -> Array:
    """Second, fourth and sixth power of radii [N], 1 at the corner of the sensor: [N, 3]."""
    square = radius * radius
    return np.stack([square, square**2, square * square**2], axis=1)  # several times as quick as `**`


def light_left(polynomials: Array, radius: Array) -> Array:
    """Return what falloffs [N, 3] leave of the light at radii [N], each of its own; 1 in the middle."""
    square, (second, fourth, sixth) = radius * radius, polynomials.T
    return np.asarray(1.0 + square * (second + square * (fourth + square * sixth)))


def demeaned(values: Array, weight: Array, track: Integers) -> Array:
    """Values [N, C] less the weighted mean of their track; track: its number, of each value [N]."""
    total = np.bincount(track, weight)
    residual = np.empty(values.shape)
    for column in range(values.shape[1]):
        residual[:, column] = (
            values[:, column] - (np.bincount(track, weight * values[:, column]) / total)[track]
        )
    return residual
