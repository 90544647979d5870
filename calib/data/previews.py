"""The pictures that features are found in: radiance, log-encoded and locally normalised.

SIFT on linear light finds nothing in the dark; on the logarithm of merged radiance, less its local
mean, dim and bright parts of a scene look alike (Rana 2016, Suma 2016 recommend local operators).
"""

import cv2
import numpy as np
from scipy import ndimage

from imaging.arrays import Array, Array32
from imaging.merge.bracket import ROWS, Merged

LONGEST_SIDE = 1600
"""px; larger images are reduced to it for features, upright ones as much as those that lie."""
LONGEST_ENLARGED = 4096
"""Rows of a picture that is enlarged, at most."""
MIN_WIDTH = 640
"""Narrower ones are enlarged to it, inside the feature extractor only: SIFT's first octave is coarse."""
LOCAL_SHARE = 0.8
"""Share of the local mean that is subtracted; all of it would leave halos as the only large features."""
SAMPLE = 500_000
"""Number of a view's values that measure its overall brightness."""
FAINT = 4.0
"""Signal-to-noise ratio of photosites below which a view is smoothed, so that noise hides no features."""
BLUR = 1.0
"""px, of a faint picture."""
FLOORS = 2.0, 8.0
"""Noise floors added before the logarithm; the more of them in a faint picture, lest its shadows be noise."""
_HOT = 2.0
"""Ratio to the light of all like photosites around above which one shows a defect, and no scene."""
_NARROW = 8.0
"""Standard deviation, px, from twice of which on a blur is made in a reduced picture."""
_THIRDS = np.full(3, 1 / 3, np.float32)
_BINOMIAL = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 16


def preview(merged: Merged) -> Array32:
    """The feature picture of merged radiance [H, W] (mosaic) or [H, W, 3]: float32 [h, w] in 0..1.

    At most LONGEST_SIDE wide or high; grey where the view shows nothing.
    """
    brightness, sigma = luminance(merged)
    height, width = brightness.shape
    if max(width, height) > LONGEST_SIDE:
        share = LONGEST_SIDE / max(width, height)
        size = (max(1, round(share * width)), max(1, round(share * height)))
        brightness = cv2.resize(brightness, size, interpolation=cv2.INTER_AREA)
        sigma = cv2.resize(sigma, size, interpolation=cv2.INTER_AREA)
    faint = is_faint(merged)
    if faint:
        brightness = ndimage.gaussian_filter(brightness, BLUR, mode="mirror")
        sigma = ndimage.gaussian_filter(sigma, BLUR, mode="mirror") / (2 * np.sqrt(np.pi) * BLUR)
    # The noise of the darkest fifth is the floor: below it there is nothing to see.
    floor = float(np.median(sigma[sigma <= np.percentile(sigma, 20)]))
    floor = max(floor, 1e-6 * float(np.max(brightness, initial=0.0)), 1e-30)
    stops = np.log2(np.maximum(brightness, -floor) + FLOORS[faint] * floor)
    flat = stops - LOCAL_SHARE * blurred(stops, max(stops.shape[1] / 40, 1.0))
    low, high = (float(value) for value in np.percentile(flat, (0.5, 99.5)))
    if high - low < 1e-6:
        return np.full(flat.shape, 0.5, np.float32)
    return np.asarray(np.clip((flat - low) / (high - low), 0.0, 1.0), np.float32)


def blurred(picture: Array, radius: float) -> Array32:
    """A picture [h, w] under a Gaussian of that standard deviation, px; a wide one of a reduced picture."""
    height, width = picture.shape
    reduced = max(int(radius / _NARROW), 1)
    size = max(width // reduced, 1), max(height // reduced, 1)
    small = cv2.resize(picture.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    blurred = ndimage.gaussian_filter(small, radius / reduced)
    return np.asarray(cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def is_faint(merged: Merged) -> bool:
    """Return whether most of a view is little more than noise."""
    if merged.sigma is None or not merged.valid.any():
        return False
    # Coprime to the channels of a pixel and the tiles of a mosaic, so that all of them are among the sample.
    step = 1 + 6 * (merged.valid.size // (6 * SAMPLE))
    valid = merged.valid.reshape(-1)[::step]
    if not valid.any():
        return False
    light, noise = (
        float(np.median(part.reshape(-1)[::step][valid])) for part in (merged.radiance, merged.sigma)
    )
    return light < FAINT * noise


def enlargement(width: int, height: int) -> int:
    """Whole factor by which the feature extractor sees a picture of this size enlarged.

    Of a narrow strip no more than its length allows: it would not end, or take the memory.
    """
    if width >= MIN_WIDTH:
        return 1
    return max(1, min(round(MIN_WIDTH / width), LONGEST_ENLARGED // height))


def luminance(merged: Merged) -> tuple[Array, Array]:
    """Brightness and its noise, [H, W]; a mosaic is smoothed over its 2x2 tiles, so that no checker stays."""
    if merged.radiance.ndim == 3:
        return _mean_of_channels(merged)
    known = merged.valid | merged.clipped | merged.dark
    radiance = np.where(known, merged.radiance, 0.0).astype(np.float64)
    if merged.sigma is None:
        sigma = np.zeros(radiance.shape)
    else:
        sigma = np.where(np.isfinite(merged.sigma), merged.sigma, 0.0).astype(np.float64)
    radiance = _without_hot(radiance, sigma)
    smooth = ndimage.convolve(radiance, _BINOMIAL, mode="mirror")
    return smooth, np.sqrt(ndimage.convolve(sigma**2, _BINOMIAL**2, mode="mirror"))


def _mean_of_channels(merged: Merged) -> tuple[Array, Array]:
    """The same of [H, W, 3], some rows at a time."""
    brightness, sigma = np.empty(merged.radiance.shape[:2]), np.zeros(merged.radiance.shape[:2])
    for top in range(0, len(brightness), ROWS):
        rows = slice(top, top + ROWS)
        known = merged.valid[rows] | merged.clipped[rows] | merged.dark[rows]
        brightness[rows] = np.where(known, merged.radiance[rows], 0.0) @ _THIRDS
        if merged.sigma is not None:
            finite = np.where(np.isfinite(merged.sigma[rows]), merged.sigma[rows], 0.0)
            sigma[rows] = np.sqrt((finite**2) @ _THIRDS / 3)
    return brightness, sigma


def _without_hot(radiance: Array, sigma: Array) -> Array:
    """A mosaic [H, W] whose hot photosites have the median of those of their colour around them.

    They stand still when the camera moves, and would be matched between all of its views.
    """
    around = np.zeros((5, 5), bool)
    around[::2, ::2] = True
    around[2, 2] = False
    limit = _HOT * ndimage.maximum_filter(radiance, footprint=around, mode="mirror") + 5 * sigma
    rows, columns = np.nonzero(radiance > limit)
    padded = np.pad(radiance, 2, mode="reflect")
    near = np.stack([padded[rows + row, columns + column] for row, column in np.argwhere(around)])
    cleaned = radiance.copy()
    if len(rows):
        cleaned[rows, columns] = np.median(near, axis=0)
    return cleaned
