"""Response curves fitted to overlapping exposures, and the exposures with them.

Unknown are the curve, the light of each photosite and, within the trust that labels deserve, the exposures:
of a code z in step j of photosite i, `g(z) = ln E_i + ln k_j + shift_j` (Debevec and Malik, "Recovering High
Dynamic Range Radiance Maps from Photographs", SIGGRAPH 97; exposures free as in Mitsunaga and Nayar,
"Radiometric Self Calibration", CVPR 99). The light is eliminated, so that the unknowns are as few as the
parameters of the curve and the steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.optimize import nnls

from calib.light.curves.codes import FOLDS, HIGHEST, LOWEST, Samples, counting
from calib.light.curves.response_models import GRID, PER_CODE, SRGB, Index, Shape, Spline, at
from imaging.arrays import Array, Mask
from imaging.merge.ratios import LABEL_SIGMA
from imaging.robust import huber_weight

HUBER = 2.5
ITERATIONS = 6
PIECE = 128
FIRM = 1e8
"""Weight of labels that are taken as they are, against 1."""
FLOOR = 0.005
"""Disagreement of two exposures, natural log, that no averaging takes away: flicker, glare, development."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Samples of one channel: only codes that count, only photosites with two exposures or more.

    code, step, site: one entry a sample, in order of the sites; group: of each photosite. `steps` are the
    distinct labels, ln k.
    """

    code: Array
    step: Index
    site: Index
    group: Index
    steps: Array

    @cached_property
    def place(self) -> Index:
        """Place of each sample's code on the grid."""
        return at(self.code)

    @cached_property
    def log_k(self) -> Array:
        """ln of each sample's label."""
        return self.steps[self.step]

    @cached_property
    def begins(self) -> npt.NDArray[np.int32]:
        """Index of each photosite's first sample, and the end of the last one's."""
        return np.searchsorted(self.site, np.arange(len(self.group) + 1)).astype(np.int32)

    def only(self, keep: Mask) -> "Channel":
        """The photosites for which `keep` (one flag a photosite) holds."""
        rows = keep[self.site]
        number = np.cumsum(keep) - 1
        return Channel(
            self.code[rows], self.step[rows], number[self.site[rows]], self.group[keep], self.steps
        )


@dataclass(frozen=True, eq=False)
class CurveModel:
    """theta: parameters of the shape; shift: [steps], ln of the exposures over their labels."""

    shape: Shape
    theta: Array
    shift: Array

    @cached_property
    def values(self) -> Array:
        """The curve on the grid; in step with sRGB beyond the codes that are used, where it would fall."""
        values = self.shape.curve(self.theta).copy()
        low, high = at(np.array([LOWEST, HIGHEST]))
        for part, edge in ((slice(PER_CODE, low + 1), low), (slice(high, None), high)):
            if np.any(np.diff(values[part]) <= 0):
                values[part] = values[edge] + SRGB[part] - SRGB[edge]
        return values

    def curve(self, codes: Array) -> Array:
        """g, natural log, at codes 0..255."""
        return self.values[at(codes)]

    def slope(self, codes: Array) -> Array:
        """dg/dz, per code."""
        place = at(codes)
        half = PER_CODE // 2
        low, high = np.maximum(place - half, 0), np.minimum(place + half, len(GRID) - 1)
        return np.maximum((self.values[high] - self.values[low]) / (GRID[high] - GRID[low]), 1e-3)

    def rises(self) -> bool:
        """Return whether the curve rises from code 1 to 255."""
        return bool(np.all(np.diff(self.values[PER_CODE :: PER_CODE // 2]) > 0))

    def light(self, channel: Channel) -> Array:
        """g(z) - ln k of each sample: the log light that it says its photosite has."""
        return np.asarray(self.values[channel.place] - channel.log_k - self.shift[channel.step])

    def residuals(self, channel: Channel, sigma: Array) -> Array:
        """`light` minus the photosite's own, which is the weighted mean of its exposures."""
        value = self.light(channel)
        weight = 1.0 / sigma**2
        count = len(channel.group)
        total = np.bincount(channel.site, weights=weight, minlength=count)
        mean = np.bincount(channel.site, weights=weight * value, minlength=count) / total
        return np.asarray(value - mean[channel.site])


@dataclass(frozen=True)
class CodeNoise:
    """Variance of a code value z: `constant + shot * z`."""

    constant: float
    shot: float

    def of(self, channel: Channel) -> Array:
        """Standard deviation of g at each sample; under sRGB, so that all curves are judged alike."""
        return _deviation(self)[channel.place]


def _deviation(noise: CodeNoise) -> Array:
    slope = np.maximum(np.gradient(SRGB, GRID), 1e-3)
    return np.asarray(np.sqrt(slope**2 * (noise.constant + noise.shot * GRID) + FLOOR**2))


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal matrix and right side [P + steps] of one channel, its photosites' light eliminated."""

    normal: Array
    right: Array

    @classmethod
    def of(cls, channel: Channel, model: CurveModel, weight: Array) -> "Equations":
        """Linearised at a model; what they are solved by is the change of theta and shift."""
        slopes = model.shape.slopes(model.theta)
        sites, steps = len(channel.group), len(channel.steps)
        value = weight * model.light(channel)
        by_code = sparse.csr_array((weight, channel.place, channel.begins), (sites, len(GRID)))
        by_step = _table(channel.site, channel.step, weight, (sites, steps))
        shared = _table(channel.place, channel.step, weight, (len(GRID), steps))
        sums = np.concatenate([by_code @ slopes, -by_step], axis=1)
        total = by_step.sum(1)
        cross = -_product(slopes, shared)
        normal = np.block(
            [[_product(slopes, shared.sum(1)[:, None] * slopes), cross], [cross.T, np.diag(shared.sum(0))]]
        )
        mean = np.bincount(channel.site, weights=value, minlength=sites) / total
        along_codes = _table(channel.place, np.zeros_like(channel.place), value, (len(GRID), 1))
        along = np.concatenate(
            [
                _product(slopes, along_codes).ravel(),
                -np.bincount(channel.step, weights=value, minlength=steps),
            ]
        )
        return cls(
            normal - _product(sums, sums / total[:, None]), -(along - _product(sums, mean[:, None]).ravel())
        )


def _product(a: Array, b: Array) -> Array:
    """a.T @ b of tall matrices, in pieces too small for BLAS to wake its threads.

    On a busy machine these take ten times longer to meet than to multiply.
    """
    count = len(a) // PIECE
    whole = count * PIECE
    left, right = (tall[:whole].reshape(count, PIECE, tall.shape[1]) for tall in (a, b))
    return np.asarray((left.swapaxes(1, 2) @ right).sum(axis=0) + a[whole:].T @ b[whole:], np.float64)


def _table(rows: Index, columns: Index, weight: Array, shape: tuple[int, int]) -> Array:
    flat = np.bincount(rows * shape[1] + columns, weights=weight, minlength=shape[0] * shape[1])
    return flat.reshape(shape).astype(np.float64)


def neighbours(channel: Channel) -> tuple[Index, Index]:
    """Samples of the same photosite in neighbouring exposures: indices of the shorter and of the longer."""
    order = np.lexsort((channel.log_k, channel.site))
    same = np.diff(channel.site[order]) == 0
    return order[:-1][same], order[1:][same]


def channels_of(samples: Samples) -> list[Channel]:
    """The channels of the samples; exposures of one label count as one step.

    Groups are numbered anew, without those that masks leave empty; few ones are split, so that all of
    `FOLDS` hold some.
    """
    used, log_k = counting(samples), samples.log_k.round(6)
    steps = np.unique(log_k[used.any(-1)])
    group = samples.group
    if any(len(np.unique(group[used[..., index].any(1)])) < FOLDS for index in range(3)):
        group = group * FOLDS + np.arange(len(group)) % FOLDS
    groups = np.unique(group[used.any((1, 2))])
    channels = []
    for index in range(3):
        rows, column = np.nonzero(used[..., index])
        chosen, site = np.unique(rows, return_inverse=True)
        step, number = np.searchsorted(steps, log_k[rows, column]), np.searchsorted(groups, group[chosen])
        channels.append(Channel(samples.codes[rows, column, index], step, site, number, steps))
    return channels


def fit(
    channels: Sequence[Channel], shape: Shape, noise: Sequence[CodeNoise], *, labels_hold: bool = False
) -> list[CurveModel]:
    """The curves of the channels, robustly; the exposures are common to them, free or those of the labels."""
    sigmas = [channel_noise.of(channel) for channel, channel_noise in zip(channels, noise, strict=True)]
    shift = np.zeros(len(channels[0].steps))
    models = [CurveModel(shape, shape.start, shift) for _ in channels]
    trust = np.full(len(shift), FIRM if labels_hold else 1.0)
    for _ in range(ITERATIONS):
        weights = [
            huber_weight(model.residuals(channel, sigma) / sigma, HUBER) / sigma**2
            for channel, model, sigma in zip(channels, models, sigmas, strict=True)
        ]
        parts = [
            Equations.of(channel, model, weight)
            for channel, model, weight in zip(channels, models, weights, strict=True)
        ]
        models = moved(models, parts, channels[0].steps, trust)
        if not labels_hold:
            trust = label_trust(channels[0].steps, models[0].shift)
    return models


def moved(
    models: Sequence[CurveModel], parts: Sequence[Equations], labels: Array, trust: Array
) -> list[CurveModel]:
    """The models after one step of Gauss and Newton; `parts`: the equations of each channel.

    labels: ln of each step's; trust: 0..1, how much each counts.
    """
    shape, shift, steps = models[0].shape, models[0].shift, len(models[0].shift)
    free = len(models[0].theta)
    count = free * len(models) + steps
    normal, right = np.zeros((count, count)), np.zeros(count)
    for index, (model, part) in enumerate(zip(models, parts, strict=True)):
        shape_columns = np.r_[index * free : (index + 1) * free]
        columns = np.r_[shape_columns, count - steps : count]
        normal[np.ix_(columns, columns)] += part.normal
        right[columns] += part.right
        normal[np.ix_(shape_columns, shape_columns)] += shape.penalty
        right[shape_columns] -= shape.penalty @ model.theta
    prior = np.diag(trust) / LABEL_SIGMA**2 + _gauge(labels, trust)
    normal[count - steps :, count - steps :] += prior
    right[count - steps :] -= prior @ shift
    change = np.linalg.solve(normal, right)
    return [
        CurveModel(shape, model.theta + change[index * free : (index + 1) * free], shift + change[-steps:])
        for index, model in enumerate(models)
    ]


def _gauge(steps: Array, trust: Array) -> Array:
    """Keeps the shifts from scaling or moving all exposures at once.

    g -> a g + b with ln k -> a ln k + b changes no residual but makes all of them smaller with a, so
    the fit would shrink the curve to nothing; scale and exponent are those of the labels that are trusted.
    """
    centred = steps - (trust * steps).sum() / trust.sum()
    directions = np.minimum(trust, 1.0) * np.stack(
        [np.ones_like(steps), centred / max(np.abs(centred).max(), 1e-9)]
    )
    return np.asarray(1e8 * directions.T @ directions)


def label_trust(steps: Array, shift: Array) -> Array:
    """0..1: how much each label agrees with most of the others (Geman and McClure's weight).

    Departures are from the line of the smallest loss, sought from every pair of labels, so that one label
    that is far off does not tilt the exponent of the curve. (The smallest sum of departures would not do: of
    four labels a wrong one at the end pulls the line as well as the others hold it. Nor would Cauchy's
    weight, under which a label that is off by two still tilts it by 0.5 %.)
    """
    lines = [
        (shift[j] - shift[i]) / (steps[j] - steps[i]) * (steps - steps[i]) + shift[i]
        for i, j in combinations(range(len(steps)), 2)
    ]
    if not lines:
        return np.ones(len(steps))
    trust = _trust(shift - min(lines, key=lambda line: float((1.0 - np.sqrt(_trust(shift - line))).sum())))
    for _ in range(ITERATIONS):
        across = steps - (trust * steps).sum() / trust.sum()
        away = shift - (trust * shift).sum() / trust.sum()
        trust = _trust(away - across * (trust * across * away).sum() / (trust * across**2).sum())
    return trust


def _trust(away: Array) -> Array:
    return np.asarray((1.0 + (0.5 * away / LABEL_SIGMA) ** 2) ** -2)


def noise_of(channel: Channel) -> CodeNoise:
    """Noise of the codes, from what neighbouring exposures of a photosite disagree by.

    From a first curve that trusts every code alike; differences are taken by median in ranges of code, so
    that what moved does not count. (Residuals would not do: where one exposure dominates they vanish.)
    """
    flat = CodeNoise(1.0, 0.0)
    model = fit([channel], Spline(1e5), [flat])[0]
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
    return CodeNoise(float(max(constant, 0.01)), float(shot))
