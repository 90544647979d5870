"""Fit of a camera's matrix to a chart's patches: neutral colours stay neutral.

The matrix takes camera RGB to linear Rec.709 and is one with whatever the exposure, as radiance over
many stops demands. Polynomials of camera RGB fit a chart a little better, but those that are not
homogeneous bend colours with exposure, and root-polynomials (Finlayson, Mackiewicz and Hurlbert 2015),
which do not, are not additive: the sum of two lights, as every blur, mixture and rendering forms it,
would get another colour than its parts. So neither is offered.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize

from calib.colour.chart_values import NEUTRAL
from imaging.arrays import Array, Mask
from imaging.colour.difference import delta_e, lab

ROUNDS = 4
PATCH_ERROR = 0.01
"""Relative, that a grey of a real chart may be off its published value."""
FLARE = 0.002
"""Stray light, or black that is not quite black, relative to white: dark greys count for less."""
LIGHTNESS_ERROR = 0.5
"""Delta E that a patch of a real chart may be off its published value: no patch counts for more."""


@dataclass(frozen=True, eq=False)
class ChartPatches:
    """Measurements of the chart by one camera; all of the 24 patches have a row.

    rgb: float64 [24, 3], camera RGB, linear, in any unit; sigma: float64 [24, 3], of its standard error;
    place: float64 [24, 2], on the chart, -1..1; usable: bool [24].
    """

    rgb: Array
    sigma: Array
    place: Array
    usable: Mask

    def without(self, patch: int) -> "ChartPatches":
        """The same with one patch left out."""
        usable = self.usable.copy()
        usable[patch] = False
        return ChartPatches(self.rgb, self.sigma, self.place, usable)


@dataclass(frozen=True, eq=False)
class Fit:
    """A camera as the chart shows it: `rec709 = matrix @ (rgb / (white * light))`.

    matrix: float64 [3, 3], its rows summing to 1; white: float64 [3], camera RGB of a perfect diffuser at the
    centre of the chart; slope: float64 [2], growth of the light over the chart, natural log.
    """

    matrix: Array
    white: Array
    slope: Array

    def colours(self, patches: ChartPatches) -> Array:
        """Linear Rec.709 of all patches, float64 [24, 3]."""
        return np.asarray(self._balanced(patches) @ self.matrix.T)

    def _balanced(self, patches: ChartPatches) -> Array:
        return np.asarray(patches.rgb / self.white / np.exp(patches.place @ self.slope)[:, None])

    @property
    def camera_from_rec709(self) -> Array:
        """float64 [3, 3], the row of green summing to 1."""
        return np.asarray((self.white / self.white[1])[:, None] * np.linalg.inv(self.matrix))


@dataclass(frozen=True, eq=False)
class ColourModel:
    """Free parameters of a fit.

    matrix: float64 [3, 3] to keep, its rows summing to 1; None: to be fitted. white: camera RGB [3] of white,
    of any scale, to keep; None: from the chart's greys. shaded: whether the light may grow across
    the chart.
    """

    matrix: Array | None = None
    white: Array | None = None
    shaded: bool = False


def of_camera(camera_from_rec709: npt.ArrayLike, *, balanced: bool) -> ColourModel:
    """The model of a camera whose files name its matrix; balanced: white is what the chart says."""
    camera = np.asarray(camera_from_rec709, np.float64)
    white = camera.sum(axis=1)
    return ColourModel(np.linalg.inv(camera) * white, None if balanced else white)


def fit(cameras: Sequence[ChartPatches], reference: Array, model: ColourModel) -> list[Fit]:
    """One fit for each camera, all with the same matrix; reference: linear Rec.709 [24, 3].

    Whites, the light's slope and the matrix are found in turn, each by weighted least squares in Lab.
    """
    matrix = np.eye(3) if model.matrix is None else model.matrix
    fits = [Fit(matrix, np.ones(3), np.zeros(2)) for _ in cameras]
    for _ in range(ROUNDS):
        fits = [_lit(one, patches, reference, model) for one, patches in zip(fits, cameras, strict=True)]
        if model.matrix is None:
            matrix = _matrix(fits, cameras, reference)
            fits = [Fit(matrix, one.white, one.slope) for one in fits]
    return [_lit(one, patches, reference, model) for one, patches in zip(fits, cameras, strict=True)]


def held_out(cameras: Sequence[ChartPatches], reference: Array, model: ColourModel) -> list[Array]:
    """CIEDE2000 of every patch under the fit that never saw it: float64 [24] a camera, NaN where unusable."""
    errors = [np.full(len(reference), np.nan) for _ in cameras]
    for patch in range(len(reference)):
        rest = [one.without(patch) for one in cameras]
        for error, patches, fitted in zip(errors, cameras, fit(rest, reference, model), strict=True):
            if patches.usable[patch]:
                error[patch] = delta_e(fitted.colours(patches)[patch], reference[patch])
    return errors


def _lit(fit: Fit, patches: ChartPatches, reference: Array, model: ColourModel) -> Fit:
    """White, and the light's slope, under a matrix that is given."""
    usable = patches.usable
    expected = reference @ np.linalg.inv(fit.matrix).T
    ratio = np.maximum(patches.rgb, 1e-12) / np.maximum(expected, 1e-4)
    slope = fit.slope
    if model.shaded:
        # Green alone stands for brightness; in it, one patch is as far off as another.
        design = np.column_stack([np.ones(usable.sum()), patches.place[usable]])
        weight = 1.0 / (0.02 + patches.sigma[usable, 1] / np.maximum(patches.rgb[usable, 1], 1e-12))
        target = np.log(ratio[usable, 1])
        for _ in range(3):
            solution = np.linalg.lstsq(design * weight[:, None], target * weight, rcond=None)[0]
            residual = np.abs(target - design @ solution)
            weight = np.minimum(weight, weight * 0.05 / np.maximum(residual, 0.05))
        slope = solution[1:]
    light = np.exp(patches.place @ slope)[:, None]
    grey = usable & np.isin(np.arange(len(usable)), NEUTRAL)
    if model.white is not None or not grey.any():
        grey = usable
    noise = (patches.sigma / np.maximum(patches.rgb, 1e-12))[grey]
    variance = PATCH_ERROR**2 + (FLARE / np.maximum(expected[grey], 1e-4)) ** 2 + noise**2
    weight = 1.0 / variance
    own_white = np.log((ratio / light)[grey])
    white = np.exp((weight * own_white).sum(axis=0) / weight.sum(axis=0))
    if model.white is not None:
        white = model.white * float(np.exp(np.mean(np.log(white / model.white))))
    return Fit(fit.matrix, white, np.asarray(slope))


def _matrix(fits: Sequence[Fit], cameras: Sequence[ChartPatches], reference: Array) -> Array:
    """The matrix whose rows sum to 1 that brings all cameras' patches nearest to the reference in Lab."""
    balanced = np.concatenate(
        [one._balanced(patches)[patches.usable] for one, patches in zip(fits, cameras, strict=True)]
    )
    noise = np.concatenate(
        [(patches.sigma / np.maximum(patches.rgb, 1e-12))[patches.usable].max(1) for patches in cameras]
    )
    target = lab(np.concatenate([reference[patches.usable] for patches in cameras]))
    # A relative error of light is about a third of it in lightness, which runs to 100.
    weight = LIGHTNESS_ERROR / np.hypot(LIGHTNESS_ERROR, 33.0 * noise)

    def residual(free: Array) -> Array:
        return np.asarray(((lab(balanced @ _unit_rows(free).T) - target) * weight[:, None]).ravel())

    start = fits[0].matrix
    solution = optimize.least_squares(
        residual, start[~np.eye(3, dtype=bool)], x_scale=0.1, loss="soft_l1", f_scale=3.0
    )
    return _unit_rows(solution.x)


def _unit_rows(free: Array) -> Array:
    """The matrix with these six values off its diagonal, its rows summing to 1."""
    matrix = np.zeros((3, 3))
    matrix[~np.eye(3, dtype=bool)] = free
    return np.asarray(matrix + np.diag(1.0 - matrix.sum(axis=1)))
