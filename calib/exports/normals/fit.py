"""Photometric stereo: the normal and the albedo of each pixel, from its light under known lamps.

A matt surface of albedo a and normal n has the light a n.L under a lamp whose light falls in along L, scaled
by its strength. Weighted least squares give a n from three lamps or more. What does not fit is left out:
shadows, highlights, and what is saturated. Such outliers are detected by weights that fall with the residual
(Huber), then by a bound on it.

R. J. Woodham, "Photometric method for determining surface orientation from multiple images", Optical
Engineering 19(1), 1980.
"""

import math
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array, Array32, Floats, Mask
from imaging.compute.jit import compiled
from imaging.compute.threads import share_pieces

FEWEST = 3
"""Lamps that determine a normal."""
SHADOW = 0.1
"""Share of the light of the third brightest lamp below which a lamp counts as hidden to begin with."""
DARK = 3.0
"""Standard deviations by which light that counts to begin with is above black."""
BEYOND = 4.0
"""Standard deviations of a residual, or of all where they are larger, beyond which light is left out."""
MATT = 0.12
"""Relative residual beyond that of noise with which the light is not that of one matt surface: at edges."""
MOST_ERROR = math.radians(20.0)
"""Standard error beyond which a normal counts as unknown."""
_ROUNDS = 8


@dataclass(frozen=True, eq=False)
class PixelFit:
    """Fit of P pixels of C channels; 0 where unknown, with infinite errors.

    normal: unit [P, 3]; error: its standard error, radians [P]; albedo, albedo_error: [P, C], the latter
    without that of the lamps' common scale; lamps: number of those that count [P].
    """

    normal: Array32
    error: Array32
    albedo: Array32
    albedo_error: Array32
    lamps: Array32

    @property
    def known(self) -> Mask:
        """Pixels with a normal [P]."""
        return np.isfinite(self.error)


def fit(light: Floats, sigma: Floats, lamps: Floats, spread: float) -> PixelFit:
    """Fit every pixel.

    Standard errors are of noise and of the lamps' spread, times the root of the reduced chi-squared where it
    is above 1.

    Args:
        light: [L, P, C] under each of L lamps, without that of the room.
        sigma: Standard deviations of noise; infinite or NaN where the light is a bound or no number.
        lamps: Light that falls in along each axis [L, P, 3].
        spread: Relative standard error of a lamp's light.
    """
    _, pixels, channels = light.shape
    vectors = np.zeros((channels, pixels, 3))
    covariances = np.full((channels, pixels, 3, 3), np.inf)
    counted = np.zeros((channels, pixels))

    def piece(first: int, last: int) -> None:
        at = slice(first, last)
        for channel in range(channels):
            _fit_series(
                np.ascontiguousarray(light[:, at, channel], np.float64),
                np.ascontiguousarray(sigma[:, at, channel], np.float64),
                np.ascontiguousarray(lamps[:, at], np.float64),
                spread, vectors[channel, at], covariances[channel, at], counted[channel, at],
            )  # fmt: skip

    share_pieces(pixels, 4096, piece)
    return _joined(vectors, covariances, counted)


def _joined(vectors: Array, covariances: Array, counted: Array) -> PixelFit:
    """One normal for the channels [C, P] of each pixel: the direction that their vectors agree on best."""
    solved = np.isfinite(covariances[..., 0, 0])
    safe = np.where(solved[..., None, None], covariances, np.eye(3))
    weights = np.where(solved, 1.0 / np.trace(safe, axis1=2, axis2=3), 0.0)
    if len(vectors) == 1:
        direction = vectors[0]
    else:
        moment = np.einsum("cp,cpi,cpj->pij", weights, vectors, vectors)
        direction = np.linalg.eigh(moment)[1][..., 2]
        direction = direction * np.sign(np.einsum("cp,cpi,pi->p", weights, vectors, direction))[:, None]
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    normal = np.divide(direction, length, out=np.zeros_like(direction), where=length > 0)
    albedo = np.einsum("cpi,pi->cp", vectors, normal)
    along = np.einsum("cpij,pi,pj->cp", safe, normal, normal)
    across = np.maximum(np.trace(safe, axis1=2, axis2=3) - along, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        precision = np.where(solved & (across > 0), albedo**2 / across, 0.0).sum(axis=0)
        error = 1.0 / np.sqrt(precision)
    known = solved.all(axis=0) & (error < MOST_ERROR) & (albedo > 0).all(axis=0)
    return PixelFit(
        np.where(known[:, None], normal, 0.0).astype(np.float32),
        np.where(known, error, np.inf).astype(np.float32),
        np.where(known, albedo, 0.0).T.astype(np.float32),
        np.where(known, np.sqrt(along), np.inf).T.astype(np.float32),
        counted.min(axis=0).astype(np.float32),
    )


@compiled
def _fit_series(
    light: np.ndarray,
    sigma: np.ndarray,
    lamps: np.ndarray,
    spread: float,
    vectors: np.ndarray,
    covariances: np.ndarray,
    counted: np.ndarray,
) -> None:
    """Fill a n [P, 3], its covariance [P, 3, 3] and the number of lamps that count [P] of light [L, P]."""
    count, pixels = light.shape
    deviation, residuals, weights = np.empty(count), np.empty(count), np.empty(count)
    usable, lit, chosen = np.empty(count, np.bool_), np.empty(count, np.bool_), np.empty(count, np.bool_)
    vector, inverse = np.empty(3), np.empty((3, 3))
    for pixel in range(pixels):
        values, axes = light[:, pixel], lamps[:, pixel]
        if not _begin(values, sigma[:, pixel], axes, spread, deviation, usable, lit):
            continue
        if not _reweighted(values, axes, deviation, lit, weights, vector, inverse, residuals):
            continue
        bound = _bound(residuals[lit])
        number = _refined(values, axes, deviation, usable, bound, chosen, weights, vector, inverse, residuals)
        if number == 0:
            continue
        counted[pixel] = number
        factor = _scatter(values, deviation, residuals, chosen, number)
        if factor == 0.0:
            continue
        for i in range(3):
            vectors[pixel, i] = vector[i]
            for j in range(3):
                covariances[pixel, i, j] = factor * inverse[i, j]


@compiled
def _begin(
    light: np.ndarray,
    sigma: np.ndarray,
    lamps: np.ndarray,
    spread: float,
    deviation: np.ndarray,
    usable: np.ndarray,
    lit: np.ndarray,
) -> bool:
    """Fill standard deviations, and which lamps are usable, and lit to begin with [L]; False if too few are
    usable.
    """
    ratios = np.empty(len(light))
    for lamp in range(len(light)):
        value, noise = light[lamp], sigma[lamp]
        usable[lamp] = math.isfinite(value) and math.isfinite(noise) and noise > 0.0
        deviation[lamp] = 1.0
        if usable[lamp]:
            deviation[lamp] = math.sqrt(noise * noise + (spread * value) ** 2)
            strength = lamps[lamp, 0] ** 2 + lamps[lamp, 1] ** 2 + lamps[lamp, 2] ** 2
            ratios[lamp] = value / math.sqrt(strength)
    number = usable.sum()
    if number < FEWEST:
        return False
    third = _ranked(ratios[usable], number - FEWEST)
    for lamp in range(len(light)):
        bright = usable[lamp] and ratios[lamp] > SHADOW * third
        lit[lamp] = bright and light[lamp] > DARK * deviation[lamp]
    return True


@compiled
def _reweighted(
    light: np.ndarray,
    lamps: np.ndarray,
    deviation: np.ndarray,
    lit: np.ndarray,
    weights: np.ndarray,
    vector: np.ndarray,
    inverse: np.ndarray,
    residuals: np.ndarray,
) -> bool:
    """Fill the solution of the lit lamps, whose weights fall with the residual, and its residuals [L]; False
    where it is singular.
    """
    for lamp in range(len(light)):
        weights[lamp] = 1.0 / deviation[lamp] ** 2 if lit[lamp] else 0.0
    if not _solve(light, lamps, weights, vector, inverse):
        return False
    for _ in range(_ROUNDS):
        _residuals(light, lamps, deviation, vector, residuals)
        for lamp in range(len(light)):
            if lit[lamp]:
                weights[lamp] = 1.0 / (deviation[lamp] ** 2 * max(abs(residuals[lamp]), 1.0))
        _solve(light, lamps, weights, vector, inverse)
    _residuals(light, lamps, deviation, vector, residuals)
    return True


@compiled
def _bound(residuals: np.ndarray) -> float:
    """Residual beyond which light is left out, in standard deviations, by the median of the lit lamps."""
    return BEYOND * max(1.0, 1.4826 * _ranked(np.abs(residuals), len(residuals) // 2))


@compiled
def _refined(
    light: np.ndarray,
    lamps: np.ndarray,
    deviation: np.ndarray,
    usable: np.ndarray,
    bound: float,
    chosen: np.ndarray,
    weights: np.ndarray,
    vector: np.ndarray,
    inverse: np.ndarray,
    residuals: np.ndarray,
) -> int:
    """Choose the lamps within the bound and solve with them until they stay the same; their number, 0 if
    they determine no normal.
    """
    number = 0
    chosen[:] = False
    for _ in range(_ROUNDS):
        number, changed = 0, False
        for lamp in range(len(light)):
            along = vector[0] * lamps[lamp, 0] + vector[1] * lamps[lamp, 1] + vector[2] * lamps[lamp, 2]
            fits = usable[lamp] and abs(residuals[lamp]) <= bound and along > 0.0
            changed = changed or fits != chosen[lamp]
            chosen[lamp] = fits
            weights[lamp] = 1.0 / deviation[lamp] ** 2 if fits else 0.0
            number += fits
        if number < FEWEST or not _solve(light, lamps, weights, vector, inverse):
            return 0
        if not changed:
            break
        _residuals(light, lamps, deviation, vector, residuals)
    _residuals(light, lamps, deviation, vector, residuals)
    return number


@compiled
def _scatter(
    light: np.ndarray, deviation: np.ndarray, residuals: np.ndarray, chosen: np.ndarray, number: int
) -> float:
    """Factor of the covariance: the reduced chi-squared, at least 1; 0 where light is not of one matt
    surface.
    """
    chi = rough = strength = 0.0
    for lamp in range(len(light)):
        if chosen[lamp]:
            chi += residuals[lamp] ** 2
            rough += deviation[lamp] ** 2 * (residuals[lamp] ** 2 - 1.0)
            strength += (light[lamp] - deviation[lamp] * residuals[lamp]) ** 2
    if rough > MATT**2 * strength:
        return 0.0
    return max(1.0, chi / (number - 3)) if number > 3 else 1.0


@compiled
def _ranked(values: np.ndarray, rank: int) -> float:
    """Sort an array in place, and return the value at a rank."""
    for end in range(1, len(values)):
        value, place = values[end], end
        while place > 0 and values[place - 1] > value:
            values[place] = values[place - 1]
            place -= 1
        values[place] = value
    return float(values[rank])


@compiled
def _residuals(
    light: np.ndarray, lamps: np.ndarray, deviation: np.ndarray, vector: np.ndarray, out: np.ndarray
) -> None:
    """Fill residuals [L] in standard deviations."""
    for lamp in range(len(light)):
        along = vector[0] * lamps[lamp, 0] + vector[1] * lamps[lamp, 1] + vector[2] * lamps[lamp, 2]
        out[lamp] = (light[lamp] - along) / deviation[lamp]


@compiled
def _solve(
    light: np.ndarray, lamps: np.ndarray, weights: np.ndarray, vector: np.ndarray, inverse: np.ndarray
) -> bool:
    """Fill the solution [3] and the inverse of the normal matrix [3, 3]; False where that is singular."""
    a00 = a01 = a02 = a11 = a12 = a22 = b0 = b1 = b2 = 0.0
    for lamp in range(len(light)):
        weight = weights[lamp]
        if weight > 0.0:
            x, y, z = lamps[lamp, 0], lamps[lamp, 1], lamps[lamp, 2]
            a00 += weight * x * x
            a01 += weight * x * y
            a02 += weight * x * z
            a11 += weight * y * y
            a12 += weight * y * z
            a22 += weight * z * z
            b0 += weight * light[lamp] * x
            b1 += weight * light[lamp] * y
            b2 += weight * light[lamp] * z
    c00, c01, c02 = a11 * a22 - a12 * a12, a02 * a12 - a01 * a22, a01 * a12 - a02 * a11
    determinant = a00 * c00 + a01 * c01 + a02 * c02
    if not determinant > 1e-9 * ((a00 + a11 + a22) / 3.0) ** 3:
        return False
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = c00, c01, c02
    inverse[1, 0], inverse[1, 1], inverse[1, 2] = c01, a00 * a22 - a02 * a02, a01 * a02 - a00 * a12
    inverse[2, 0], inverse[2, 1], inverse[2, 2] = c02, a01 * a02 - a00 * a12, a00 * a11 - a01 * a01
    for i in range(3):
        for j in range(3):
            inverse[i, j] /= determinant
    for i in range(3):
        vector[i] = inverse[i, 0] * b0 + inverse[i, 1] * b1 + inverse[i, 2] * b2
    return True
