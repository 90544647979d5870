"""Image metrics, in the units that papers report (METHODS, Metrics).

Every function takes arrays of one shape and raises ValueError for other shapes, for empty arrays
and for values that are not finite. Every result is a finite number, also for black images.
"""

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from imaging.arrays import AnyArray, Array, Mask

PSNR_CAP = 150.0
"""PSNR in dB for images that are equal or closer than float32 resolves: JSON has no infinity.

Its negative is the lower bound.
"""

STOPS_CAP = 32.0
"""log2 error given where the truth is light and the prediction is not."""

ERROR_CAP = 1e30
"""Largest relative error of one value."""

PU21_BANDING_GLARE = (
    0.353487901,
    0.3734658629,
    8.277049286e-5,
    0.9062562627,
    0.09150303166,
    0.9099517204,
    596.3148142,
)
"""p1..p7 of Mantiuk and Azimi, PU21 (PCS 2021), banding and glare."""

PU21_PEAK = 256.0
"""The code value of 100 cd/m2, the customary peak for PSNR on PU21 values."""

DARK_SHARE = 0.4


def mu_law(x: npt.ArrayLike, mu: float = 5000.0) -> Array:
    """log(1 + mu |x|) / log(1 + mu), with the sign of x: 0 to 0, 1 to 1, finite everywhere."""
    value = np.asarray(x, np.float64)
    size = np.minimum(np.abs(value), np.finfo(np.float64).max / mu)
    return np.asarray(np.sign(value) * np.log1p(mu * size) / np.log1p(mu))


def psnr(prediction: npt.ArrayLike, truth: npt.ArrayLike, peak: float = 1.0) -> float:
    """Peak signal-to-noise ratio, dB, at most `PSNR_CAP`; ValueError if the peak is not positive."""
    a, b = _pair(prediction, truth)
    if not 0 < peak < np.inf:
        raise ValueError(f"a peak is finite and positive, not {peak}")
    return _psnr(a, b, peak)


SSIM_RADIUS = 5
SSIM_C1, SSIM_C2 = 0.01**2, 0.03**2
"""Constants of SSIM (Wang et al. 2004): half of a window of 11 taps; K1 and K2, squared, for values on 0..1.
"""


def ssim_taps() -> Array:
    """The window's 11 taps: a Gaussian of sigma 1.5, summing to 1."""
    taps = np.exp(-0.5 * (np.arange(-SSIM_RADIUS, SSIM_RADIUS + 1) / 1.5) ** 2)
    return np.asarray(taps / taps.sum())


def ssim(prediction: npt.ArrayLike, truth: npt.ArrayLike, valid: Mask | None = None) -> float | None:
    """Mean structural similarity of images on 0..1, [H, W] or [H, W, C] (channels apart, then averaged).

    Wang et al. 2004: Gaussian window of 11 taps, sigma 1.5, K1 0.01, K2 0.03, in float64, mean over the
    windows that lie wholly inside. valid: bool of the same shape; only windows without a sample that is not
    are averaged, so that whatever a masked image is filled with has no part in it; None without such windows.
    ValueError if the image is smaller than the window.
    """
    a, b = _pair(prediction, truth)
    if a.ndim not in (2, 3) or min(a.shape[:2]) < 11:
        raise ValueError(f"SSIM needs [H, W] or [H, W, C] of 11 x 11 pixels or more, not {a.shape}")
    mean_a, mean_b = _window(a), _window(b)
    var_a = _window(a * a) - mean_a**2
    var_b = _window(b * b) - mean_b**2
    both = _window(a * b) - mean_a * mean_b
    luminance = (2 * mean_a * mean_b + SSIM_C1) / (mean_a**2 + mean_b**2 + SSIM_C1)
    structure = (2 * both + SSIM_C2) / (var_a + var_b + SSIM_C2)
    similarity = luminance * structure
    if valid is None:
        return float(similarity.mean())
    whole = ndimage.minimum_filter(valid, size=(11, 11, 1)[: a.ndim])[5:-5, 5:-5]
    return float(similarity[whole].mean()) if whole.any() else None


def _window(image: Array) -> Array:
    taps, inner = ssim_taps(), slice(SSIM_RADIUS, -SSIM_RADIUS)
    rows = ndimage.correlate1d(image, taps, axis=0)[inner]
    return np.asarray(ndimage.correlate1d(rows, taps, axis=1)[:, inner])


def pu21(luminance: npt.ArrayLike) -> Array:
    """Perceptually uniform code values of luminance in cd/m2, clamped to 0.005..10000 first."""
    p1, p2, p3, p4, p5, p6, p7 = PU21_BANDING_GLARE
    power = np.clip(np.asarray(luminance, np.float64), 0.005, 10000.0) ** p4
    return np.asarray(p7 * (((p1 + p2 * power) / (1 + p3 * power)) ** p5 - p6))


def pu21_psnr(
    prediction: npt.ArrayLike,
    truth: npt.ArrayLike,
    display_peak: float = 1000.0,
    scene_peak: float | None = None,
) -> float:
    """PSNR, dB, of PU21 values on a display.

    Args:
        prediction: Linear light, of any shape.
        truth: True light, of the same shape and unit.
        display_peak: Peak luminance of the display, cd/m2.
        scene_peak: Light that the display shows at its peak; None: the truth's maximum. The one scale is
            applied to both images.

    Returns:
        The ratio, dB, within `PSNR_CAP` of 0.

    Raises:
        ValueError: The shapes differ or are empty, a value is not finite, or the peak is negative or not
            finite.
    """
    a, b = _pair(prediction, truth)
    top = _peak(b, scene_peak)
    with np.errstate(over="ignore"):
        return _psnr(pu21(a / top * display_peak), pu21(b / top * display_peak), PU21_PEAK)


def hdr_psnr_mu(prediction: npt.ArrayLike, truth: npt.ArrayLike, peak: float | None = None) -> float:
    """mu-law PSNR, dB, of linear light; `peak` is the truth's maximum over the scene's test views.

    None takes the maximum of this truth. A peak of zero (a black scene) counts as 1.
    """
    a, b = _pair(prediction, truth)
    top = _peak(b, peak)
    with np.errstate(over="ignore"):
        return _psnr(mu_law(a / top), mu_law(b / top), 1.0)


def hdr_psnr_mu_dark(prediction: npt.ArrayLike, truth: npt.ArrayLike, peak: float | None = None) -> float:
    """The same over 0.4 of the peak, both clipped to -1..1: highlights count no more."""
    return hdr_psnr_mu_below(prediction, truth, DARK_SHARE * _peak(_pair(prediction, truth)[1], peak))


def hdr_psnr_mu_below(prediction: npt.ArrayLike, truth: npt.ArrayLike, peak: float) -> float:
    """mu-law PSNR, dB, over `peak`, both clipped to -1..1: a lamp above it counts as 1."""
    a, b = _pair(prediction, truth)
    top = _peak(b, peak)
    with np.errstate(over="ignore"):
        return _psnr(mu_law(np.clip(a / top, -1, 1)), mu_law(np.clip(b / top, -1, 1)), 1.0)


def align_scale(prediction: npt.ArrayLike, truth: npt.ArrayLike) -> float:
    """Factor on `prediction` that makes the median log ratio to `truth` zero.

    Over the values that are positive in both; 1 without such values.
    """
    a, b = _pair(prediction, truth)
    lit = (a > 0) & (b > 0)
    if not lit.any():
        return 1.0
    ratio = np.median(np.log(b[lit]) - np.log(a[lit]))
    return float(np.exp(np.clip(ratio, -700.0, 700.0)))  # as far as float64 goes


LIGHT = {"dark": (0.0, 0.1), "middle": (0.1, 0.99), "bright": (0.99, 1.0), "brightest": (0.999, 1.0)}
"""Quantiles of the true light: darkest tenth, what lies between, brightest hundredth and thousandth."""


def stops_median(
    prediction: npt.ArrayLike,
    truth: npt.ArrayLike,
    among: tuple[float, float] = (0.0, 1.0),
    *,
    at_least: Mask | None = None,
    at_most: Mask | None = None,
) -> float:
    """Median |log2(prediction / truth)| over the values where the truth is positive.

    Args:
        prediction: Linear light, of any shape.
        truth: True light, of the same shape and unit.
        among: Quantiles of the positive values of the truth, 0..1, between which they count; (0, 0.1): the
            darkest tenth.
        at_least: Values where the truth is but a lower bound, bool of the same shape: there a prediction is
            wrong by what it lacks.
        at_most: Values where the truth is but an upper bound, likewise: there a prediction is wrong by what
            it exceeds.

    Returns:
        The median, stops; 0 where the truth is positive nowhere. Each value counts with `STOPS_CAP` at most.

    Raises:
        ValueError: The shapes differ or are empty, or a value is not finite.
    """
    a, b = _pair(prediction, truth)
    lit = b > 0
    if not lit.any():
        return 0.0
    if among != (0.0, 1.0):
        low, high = np.quantile(b[lit], among)
        lit &= (b >= low) & (b <= high)
    shown = a[lit] > 0
    over = np.full(len(shown), -STOPS_CAP)
    over[shown] = np.clip(np.log2(a[lit][shown]) - np.log2(b[lit][shown]), -STOPS_CAP, STOPS_CAP)
    if at_least is not None:
        over = np.where(at_least[lit], np.minimum(over, 0.0), over)
    if at_most is not None:
        over = np.where(at_most[lit], np.maximum(over, 0.0), over)
    return float(np.median(np.abs(over)))


def relative_error_by_decade(prediction: npt.ArrayLike, truth: npt.ArrayLike) -> list[dict[str, float | int]]:
    """|prediction - truth| / truth for each decade of the truth, darkest first.

    Each entry: `low` and `high` (the decade's bounds, in the truth's unit), `count` (values in
    it), `median` and `p95`. Values where the truth is not positive are left out.
    """
    a, b = _pair(prediction, truth)
    lit = b > 0
    a, b = a[lit], b[lit]
    with np.errstate(over="ignore"):
        error = np.minimum(np.abs(a - b) / b, ERROR_CAP)
    decades = np.clip(np.floor(np.log10(b)), -307, 307)
    return [
        {
            "low": float(10.0**decade),
            "high": float(10.0 ** (decade + 1)),
            "count": int((decades == decade).sum()),
            "median": float(np.median(error[decades == decade])),
            "p95": float(np.percentile(error[decades == decade], 95)),
        }
        for decade in np.unique(decades)
    ]


def _pair(prediction: npt.ArrayLike, truth: npt.ArrayLike) -> tuple[Array, Array]:
    a: AnyArray = np.asarray(prediction, np.float64)
    b: AnyArray = np.asarray(truth, np.float64)
    if a.shape != b.shape:
        raise ValueError(f"prediction {a.shape} and truth {b.shape} differ in shape")
    if a.size == 0:
        raise ValueError("there is nothing to compare")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("prediction or truth holds NaN or infinity")
    return a, b


def _peak(truth: Array, peak: float | None) -> float:
    top = float(truth.max()) if peak is None else float(peak)
    if not np.isfinite(top) or (peak is not None and top < 0):
        raise ValueError(f"a peak is finite and not negative, not {top}")
    return top if top > 0 else 1.0


def _psnr(a: Array, b: Array, peak: float) -> float:
    with np.errstate(over="ignore", divide="ignore"):
        noise = -10 * np.log10(np.mean(((a - b) / peak) ** 2))
    return float(np.clip(noise, -PSNR_CAP, PSNR_CAP))
