"""A response curve as a spline of few knots on top of sRGB, fitted to overlapping exposures.

Unknown are the curve, the light of each photosite and, within the trust that labels deserve, the exposures:
of a code z in step j of photosite i, `g(z) = ln E_i + ln k_j + shift_j` (Debevec and Malik, "Recovering High
Dynamic Range Radiance Maps from Photographs", SIGGRAPH 97; exposures free as in Mitsunaga and Nayar,
"Radiometric Self Calibration", CVPR 99). The light is eliminated, so that the unknowns are as few as knots
and steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.optimize import nnls

from calib.codes import HIGHEST, LOWEST, Samples
from imaging.colour import srgb_decode
from imaging.ratios import LABEL_SIGMA

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

KNOTS = 24
MIDDLE = 128.0
"""Code at which the curve meets sRGB, for each channel alike: grey stays grey."""
HUBER = 2.5
ITERATIONS = 5
FLOOR = 0.005
"""Disagreement of two exposures, natural log, that no averaging takes away: flicker, glare, development."""


def _design(codes: Array) -> Array:
    """Cubic B-splines over the logarithm of sRGB light: there another exponent is a straight line."""
    lowest = float(_srgb(np.array([1.0]))[0])
    place = 1.0 - _srgb(np.maximum(codes, 1.0)) / lowest
    knots = np.concatenate([[0.0] * 3, np.linspace(0.0, 1.0, KNOTS - 2), [1.0] * 3])
    return np.asarray(BSpline.design_matrix(np.clip(place, 0.0, 1.0), knots, 3).toarray())


def _srgb(codes: Array) -> Array:
    return np.asarray(np.log(srgb_decode(codes / 255.0)), np.float64)


_GRID = np.arange(0.0, 255.0 + 1 / 16, 1 / 8)
_SPLINES = _design(_GRID)
_SPARSE = sparse.csr_array(_SPLINES)
_SRGB = _srgb(np.maximum(_GRID, 0.25))


@dataclass(frozen=True, eq=False)
class Channel:
    """Samples of one channel: only codes that count, only photosites with two exposures or more.

    code, log_k, step, site: one entry a sample; group: of each photosite. `steps` are the distinct labels.
    """

    code: Array
    step: Index
    site: Index
    group: Index
    steps: Array

    @property
    def log_k(self) -> Array:
        """ln of each sample's label."""
        return self.steps[self.step]

    def only(self, keep: npt.NDArray[np.bool_]) -> "Channel":
        """The photosites for which `keep` (one flag a photosite) holds."""
        rows = keep[self.site]
        number = np.cumsum(keep) - 1
        return Channel(
            self.code[rows], self.step[rows], number[self.site[rows]], self.group[keep], self.steps
        )


@dataclass(frozen=True, eq=False)
class Model:
    """theta: [KNOTS] departures from sRGB; shift: [steps], ln of the exposures over their labels."""

    theta: Array
    shift: Array

    def curve(self, codes: Array) -> Array:
        """g, natural log, at codes 0..255."""
        return np.asarray(np.interp(codes, _GRID, _SRGB + _SPLINES @ self.theta))

    def slope(self, codes: Array) -> Array:
        """dg/dz, per code."""
        return np.maximum(self.curve(codes + 0.5) - self.curve(codes - 0.5), 1e-3)

    def rises(self) -> bool:
        """Whether the curve rises from code 1 to 255."""
        return bool(np.all(np.diff(self.curve(np.arange(1.0, 255.5, 0.5))) > 0))

    def light(self, channel: Channel) -> Array:
        """g(z) - ln k of each sample: the log light that it says its photosite has."""
        return np.asarray(self.curve(channel.code) - channel.log_k - self.shift[channel.step])

    def residuals(self, channel: Channel, sigma: Array) -> Array:
        """`light` minus the photosite's own, which is the weighted mean of its exposures."""
        value = self.light(channel)
        return np.asarray(value - _mean(channel, value, 1.0 / sigma**2)[channel.site])


@dataclass(frozen=True)
class Noise:
    """Variance of a code value z: `constant + shot * z`."""

    constant: float
    shot: float

    def of(self, channel: Channel) -> Array:
        """Standard deviation of g at each sample; under sRGB, so that all curves are judged alike."""
        slope = Model(np.zeros(KNOTS), np.zeros(len(channel.steps))).slope(channel.code)
        return np.asarray(np.sqrt(slope**2 * (self.constant + self.shot * channel.code) + FLOOR**2))


def neighbours(channel: Channel) -> tuple[Index, Index]:
    """Samples of the same photosite in neighbouring exposures: indices of the shorter and of the longer."""
    order = np.lexsort((channel.log_k, channel.site))
    same = np.diff(channel.site[order]) == 0
    return order[:-1][same], order[1:][same]


def channel_of(samples: Samples, index: int) -> Channel:
    """One channel of the samples; exposures of one label count as one step."""
    code = samples.codes[..., index]
    used = np.isfinite(code) & (code >= LOWEST) & (code <= HIGHEST)
    brightest = np.where(used, samples.log_k, -np.inf).max(1)
    darkest = np.where(used, samples.log_k, np.inf).min(1)
    used &= (brightest - darkest > 0.05)[:, None]
    rows, column = np.nonzero(used)
    kept, site = np.unique(rows, return_inverse=True)
    steps = np.unique(samples.log_k.round(6))
    step = np.searchsorted(steps, samples.log_k[rows, column].round(6))
    return Channel(code[rows, column], step, site, samples.group[kept], steps)


def fit(channels: Sequence[Channel], smoothness: float | None, noise: Sequence[Noise]) -> list[Model]:
    """The curves of the channels, robustly, the exposures being common to them.

    smoothness: weight of the squared third differences of the splines; None: sRGB, with only the exposures
    free.
    """
    steps = channels[0].steps
    knots = 0 if smoothness is None else KNOTS
    count = knots * len(channels) + len(steps)
    prior = np.zeros((count, count))
    prior[count - len(steps) :, count - len(steps) :] = np.eye(len(steps)) / LABEL_SIGMA**2 + _gauge(steps)
    if smoothness is not None:
        bend = np.diff(np.eye(KNOTS), 3, axis=0)
        middle = 1e3 * _splines(np.array([MIDDLE]))
        for own in _blocks(len(channels), knots):
            prior[own, own] = smoothness * bend.T @ bend + middle.T @ middle + 1e-6 * np.eye(KNOTS)
    sigmas = [own.of(channel) for channel, own in zip(channels, noise, strict=True)]
    bases = [_basis(channel, knots) for channel in channels]
    robust = [np.ones(len(channel.code)) for channel in channels]
    models: list[Model] = []
    for _ in range(ITERATIONS):
        normal, right = prior.copy(), np.zeros(count)
        for index, (channel, sigma) in enumerate(zip(channels, sigmas, strict=True)):
            columns = np.r_[index * knots : (index + 1) * knots, count - len(steps) : count]
            own_normal, own_right = _equations(channel, bases[index], robust[index] / sigma**2)
            normal[np.ix_(columns, columns)] += own_normal
            right[columns] += own_right
        solved: Array = np.asarray(np.linalg.solve(normal, right), np.float64)
        models = [
            Model(solved[own] if knots else np.zeros(KNOTS), solved[count - len(steps) :])
            for own in _blocks(len(channels), knots)
        ]
        for index, (channel, sigma) in enumerate(zip(channels, sigmas, strict=True)):
            whitened = np.abs(models[index].residuals(channel, sigma)) / sigma
            robust[index] = np.minimum(1.0, HUBER / np.maximum(whitened, 1e-9))
    return models


def fit_rising(channels: Sequence[Channel], smoothness: float, noise: Sequence[Noise]) -> list[Model]:
    """The same, with smoothness raised until every curve rises everywhere."""
    for _ in range(8):
        models = fit(channels, smoothness, noise)
        if all(model.rises() for model in models):
            return models
        smoothness *= 10.0
    return fit(channels, None, noise)


def _blocks(count: int, knots: int) -> list[slice]:
    return [slice(index * knots, (index + 1) * knots) for index in range(count)]


def _equations(channel: Channel, basis: sparse.csr_array, weight: Array) -> tuple[Array, Array]:
    """Normal matrix and right side of one channel, its photosites' light eliminated."""
    weighted = sparse.diags_array(weight) @ basis
    known = np.interp(channel.code, _GRID, _SRGB) - channel.log_k
    samples = np.arange(len(channel.code))
    ones = np.ones(len(samples))
    owned = sparse.csr_array((ones, (channel.site, samples)), (len(channel.group), len(samples)))
    sums = (owned @ weighted).toarray()
    total = owned @ weight
    normal = (basis.T @ weighted).toarray() - sums.T @ (sums / total[:, None])
    right = weighted.T @ known - sums.T @ (owned @ (weight * known) / total)
    return np.asarray(normal), np.asarray(-right)


def _basis(channel: Channel, knots: int) -> sparse.csr_array:
    """What each sample's residual is made of: splines at its code, and its exposure."""
    rows = np.arange(len(channel.code))
    steps = sparse.csr_array((-np.ones(len(rows)), (rows, channel.step)), (len(rows), len(channel.steps)))
    if not knots:
        return steps
    return sparse.hstack([_SPARSE[np.rint(channel.code * 8).astype(np.intp)], steps], format="csr")


def noise_of(channel: Channel) -> Noise:
    """Noise of the codes, from what neighbouring exposures of a photosite disagree by.

    From a first curve that trusts every code alike; differences are taken by median in ranges of code, so
    that what moved does not count. (Residuals would not do: where one exposure dominates they vanish.)
    """
    flat = Noise(1.0, 0.0)
    model = fit([channel], 1e5, [flat])[0]
    first, second = neighbours(channel)
    light = model.light(channel)
    squares = (light[first] - light[second]) ** 2
    slopes = model.slope(channel.code) ** 2
    terms = np.stack(
        [slopes[first] + slopes[second], (slopes * channel.code)[first] + (slopes * channel.code)[second]], 1
    )
    order = np.argsort(np.minimum(channel.code[first], channel.code[second]), kind="stable")
    rows, goals = [], []
    for part in np.array_split(order, 12):
        if len(part) > 20:
            middle = np.median(terms[part], axis=0)
            rows.append(middle / middle.sum())
            goals.append(np.median(squares[part]) / 0.4549 / middle.sum())  # median of chi-square, 1 dof
    if not rows:
        return flat
    (constant, shot), _ = nnls(np.array(rows), np.array(goals))
    return Noise(float(max(constant, 0.01)), float(shot))


def huber(whitened: Array) -> Array:
    """Huber's loss of residuals in units of their standard deviation."""
    size = np.abs(whitened)
    return np.where(size < HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER))


def _gauge(steps: Array) -> Array:
    """Keeps the shifts from scaling or moving all exposures at once.

    g -> a g + b with ln k -> a ln k + b changes no residual but makes all of them smaller with a, so
    the fit would shrink the curve to nothing; scale and exponent are those of the labels.
    """
    centred = steps - steps.mean()
    directions = np.stack([np.ones_like(steps), centred / max(np.abs(centred).max(), 1e-9)])
    return np.asarray(1e8 * directions.T @ directions)


def _splines(codes: Array) -> Array:
    return np.asarray(_SPLINES[np.rint(codes * 8).astype(np.intp)])


def _mean(channel: Channel, value: Array, weight: Array) -> Array:
    count = len(channel.group)
    total = np.bincount(channel.site, weights=weight, minlength=count)
    return np.asarray(np.bincount(channel.site, weights=weight * value, minlength=count) / total)
