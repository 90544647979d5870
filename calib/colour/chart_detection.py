"""Detection of a colour chart in a view, and the measurement of its patches.

OpenCV finds the chart in a small picture of 8 bits; what is measured is linear light. A find is
believed only when the greys fall from white to black and the colours fit the chart's own.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from calib.colour.chart_values import COLUMNS, NEUTRAL, PATCHES, chart
from calib.colour.fit import ChartPatches, ColourModel, fit
from imaging.arrays import Array, Bytes, Floats, Mask
from imaging.colour.difference import delta_e
from imaging.colour.spaces import srgb_encode
from imaging.merge.bracket import Merged

NO_FALLOFF = (0.0, 0.0, 0.0)
PROXY_WIDTHS = (800, 1200)
"""Widths of the pictures that are searched; a small chart needs the larger one."""
EXPOSURES = ((99.0, 0.9), (60.0, 0.25))
"""Percentiles of light and the linear levels they are put at: for a chart in the light, and in the shade."""
MOST_FINDS = 4
INSET = 0.8
"""Share of an outline's width that is sampled. Outlines span half of their patches, and are off by up to a
seventh of them."""
LEAST_SITES = 9
"""Photosites of a channel, below which a patch is too small."""
LEAST_SNR = 10.0
UNEVEN = 0.06
"""Largest difference between the quarters of a patch, relative: more is a shadow, a gleam or its edge."""
LEAST_PATCHES = 12
MOST_DELTA_E = 8.0
"""Mean after a fit, above which what was found is no chart, or not this one."""


@dataclass(frozen=True, eq=False)
class DetectedChart:
    """A chart in a view: its patches, and their outlines float64 [24, 4, 2] in px of the whole image."""

    patches: ChartPatches
    outlines: Array
    delta_e: float


@dataclass(frozen=True)
class Missed:
    """Reason why a view gives no chart, as half a sentence; near: something chart-like was there."""

    reason: str
    near: bool = False


def locate(rgb: Floats) -> list[Array]:
    """Outlines [24, 4, 2], in px of linear camera RGB [H, W, 3], of all that looks like a chart."""
    light = _reduced(np.maximum(np.nan_to_num(rgb), 0.0).astype(np.float32), max(PROXY_WIDTHS))
    light = light / np.maximum(np.percentile(light, 90, axis=(0, 1)), 1e-12)
    finds: list[Array] = []
    for width in PROXY_WIDTHS:
        small = _reduced(light, width)
        scale = np.array((rgb.shape[1] / small.shape[1], rgb.shape[0] / small.shape[0]))
        for percentile, level in EXPOSURES:
            gain = level / max(float(np.percentile(small.mean(axis=-1), percentile)), 1e-12)
            proxy = np.rint(255 * srgb_encode(small * gain)).astype(np.uint8)
            finds += [outlines * scale for outlines in _search(np.ascontiguousarray(proxy[..., ::-1]))]
        if finds or small.shape == light.shape:
            break
    return finds


def _reduced(light: Floats, width: int) -> Floats:
    """The picture [H, W, 3] at most so wide, averaged over areas."""
    if light.shape[1] <= width:
        return light
    size = (width, max(1, round(light.shape[0] * width / light.shape[1])))
    return np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA))


def _search(proxy: Bytes) -> list[Array]:
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    # Asking for the best one without any would end the process, so the list is asked for.
    if not detector.process(proxy, MOST_FINDS):
        return []
    charts = [np.array(one.getColorCharts(), np.float64) for one in detector.getListColorChecker()]
    return [one.reshape(PATCHES, 4, 2) for one in charts if one.shape == (4 * PATCHES, 2)]


def measure_patches(
    merged: Merged, outlines: Array, vignetting: tuple[float, float, float] = NO_FALLOFF
) -> ChartPatches:
    """The patches inside these outlines [24, 4, 2], in px of the merged mosaic.

    vignetting: of the lens where it is known (`CameraCalibration.vignetting`), which is divided out.
    """
    rgb, sigma, usable = np.zeros((PATCHES, 3)), np.ones((PATCHES, 3)), np.zeros(PATCHES, bool)
    for index, outline in enumerate(outlines):
        patch = _patch(merged, outline)
        if patch is not None:
            rgb[index], sigma[index] = patch
            usable[index] = True
    height, width = merged.radiance.shape
    away = outlines.mean(axis=1) - np.array((width, height)) / 2
    square = (away**2).sum(axis=1) / ((width / 2) ** 2 + (height / 2) ** 2)
    fall = 1.0 + square[:, None] ** np.array([1, 2, 3]) @ np.array(vignetting)
    rgb, sigma = rgb / fall[:, None], sigma / fall[:, None]
    row, column = np.divmod(np.arange(PATCHES), COLUMNS)
    place = np.stack([column / 2.5 - 1, row / 1.5 - 1], axis=1)
    return ChartPatches(rgb, sigma, place, usable)


def _patch(merged: Merged, outline: Array) -> tuple[Array, Array] | None:
    """Median camera RGB of a patch and its standard error; None if it is clipped, uneven, small or dim."""
    height, width = merged.radiance.shape
    centre = outline.mean(axis=0)
    inner = centre + INSET * (outline - centre)
    low = np.maximum(np.floor(inner.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(inner.max(axis=0)).astype(int) + 1, (width, height))
    outside = (inner.min(axis=0) < 0) | (inner.max(axis=0) > (width, height))
    if outside.any() or (high <= low).any():
        return None
    x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
    inside = _inside(x, y, inner)
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    if merged.cfa is None or (merged.clipped[window] & inside).mean() > 0.01:
        return None
    channels = merged.cfa.channels(height, width)[window]
    known = inside & merged.valid[window]
    light = merged.radiance[window]
    # Quarters along the patch's own sides, whichever way it lies.
    along, down = inner[1] - inner[0], inner[3] - inner[0]
    quarter = 2 * ((x - centre[0]) * along[0] + (y - centre[1]) * along[1] > 0) + (
        (x - centre[0]) * down[0] + (y - centre[1]) * down[1] > 0
    )
    values, errors = np.zeros(3), np.zeros(3)
    for channel in range(3):
        sites_of = known & (channels == channel)
        sites = light[sites_of].astype(np.float64)
        if len(sites) < LEAST_SITES:
            return None
        values[channel], errors[channel] = _median(sites)
        if not values[channel] > LEAST_SNR * errors[channel]:
            return None
        parts = [_median(light[sites_of & (quarter == part)].astype(np.float64)) for part in range(4)]
        middles, spread = np.array(parts).T
        limit = UNEVEN * values[channel] + 4 * np.max(spread)
        if not np.ptp(middles) < limit:
            return None
    return values, errors


def _median(sites: Array) -> tuple[float, float]:
    """The median and its standard error, from the spread of the middle of the sites; infinite of nothing."""
    if len(sites) < 2:
        return float("nan"), float("inf")
    middle = float(np.median(sites))
    deviation = 1.4826 * float(np.median(np.abs(sites - middle)))
    return middle, 1.2533 * deviation / float(np.sqrt(len(sites)))


def _inside(x: Array, y: Array, corners: Array) -> Mask:
    """Return whether points lie in a convex quadrilateral [4, 2]."""
    sides = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        sides.append((end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0]))
    return np.asarray((np.array(sides) >= 0).all(axis=0) | (np.array(sides) <= 0).all(axis=0))


def best(
    merged: Merged, finds: list[Array], vignetting: tuple[float, float, float] = NO_FALLOFF
) -> DetectedChart | Missed:
    """The find that is the chart; Missed when none is."""
    if not finds:
        return Missed("nothing looks like a chart of 24 patches")
    verdicts = [judge(measure_patches(merged, outlines, vignetting), outlines) for outlines in finds]
    good = [verdict for verdict in verdicts if isinstance(verdict, DetectedChart)]
    if good:
        return min(good, key=lambda one: one.delta_e)
    return next((one for one in verdicts if isinstance(one, Missed) and one.near), verdicts[0])


def judge(patches: ChartPatches, outlines: Array) -> DetectedChart | Missed:
    """Return whether these patches are those of the chart."""
    count = int(patches.usable.sum())
    if count < LEAST_PATCHES:
        return Missed(
            f"of a possible chart only {count} of {PATCHES} patches are even, unclipped and bright enough "
            f"({LEAST_PATCHES} are needed)",
            near=True,
        )
    greys = [index for index in NEUTRAL if patches.usable[index]]
    green = patches.rgb[greys, 1]
    if len(greys) < 3 or np.any(np.diff(green) > 0):
        return Missed("the greys of a possible chart do not fall from white to black")
    reference = chart()
    (fitted,) = fit([patches], reference, ColourModel(shaded=True))
    error = float(delta_e(fitted.colours(patches), reference)[patches.usable].mean())
    if not error < MOST_DELTA_E:
        return Missed(
            f"the colours of a possible chart are not the chart's (delta E {error:.1f} after the best fit)"
        )
    return DetectedChart(patches, outlines, error)
