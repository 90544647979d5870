"""Photosites that cannot be trusted: hot or noisy in the dark, or unlike their neighbours in light."""

from typing import Literal

import numpy as np
from scipy import ndimage, special

from calib.sensor.stack import Period, Stack, sites
from imaging.arrays import Array, Array32, Mask
from imaging.sensor.cfa import repeated
from imaging.sensor.sensor_calibration import Defect

SIGMAS = 6.5
"""Distance from the neighbours, in robust standard deviations of all photosites of the site; normal
scatter passes this once in 1e10, and the skew of a few electrons still under once in 1e5."""
NEIGHBOURS = 7
"""Side of the window, in photosites of one site, whose median is the reference value."""
NOISY = 1e-9
"""Chance with which a good photosite's scatter in time passes for noisy."""


def in_the_dark(dark: Stack) -> tuple[Mask, Mask]:
    """Hot photosites and noisy ones, bool [H, W] each, from repeated darks (the longest are best)."""
    hot = _off(dark.mean, dark.tile, relative=False)
    noisy = np.zeros_like(hot)
    freedom = dark.frames - 1
    if freedom >= 7:
        planes = sites(dark.variance, dark.tile)
        usual = np.median(planes, axis=(1, 2))
        limit = max(float(special.chdtri(freedom, NOISY)) / freedom, 4.0)
        # Rounding lifts the scatter of a photosite at the edge of a code; a quarter DN^2 is its most.
        ceiling = np.maximum(usual * limit, usual + 0.25)
        noisy = _joined(planes > ceiling[:, None, None], hot.shape, dark.tile) & ~hot
    return hot, noisy


def in_light(flat: Stack, black: Array) -> Mask:
    """Photosites that answer light otherwise than their neighbours, bool [H, W]; black [sites], DN."""
    level = repeated(black.reshape(flat.tile), *flat.variance.shape)
    return _off((flat.mean - level).astype(np.float32), flat.tile, relative=True)


def listed(hot: Mask, noisy: Mask, dead: Mask) -> tuple[Defect, ...]:
    """The defects in reading order, each once: hot before dead before noisy."""
    defects: list[Defect] = []
    for row, column in zip(*np.nonzero(hot | noisy | dead), strict=True):
        at = (row, column)
        kind: Literal["hot", "dead", "noisy"] = "hot" if hot[at] else "dead" if dead[at] else "noisy"
        defects.append(Defect(x=int(column), y=int(row), kind=kind))
    return tuple(defects)


def _off(image: Array32, tile: Period, relative: bool) -> Mask:
    """Return where an image is far off the median of its neighbours of the same CFA site."""
    planes = sites(image, tile).astype(np.float64)
    far = np.zeros(planes.shape, bool)
    for site, plane in enumerate(planes):
        around = ndimage.median_filter(plane, NEIGHBOURS, mode="mirror")
        apart = plane / np.maximum(around, 1e-6) - 1.0 if relative else plane - around
        middle = float(np.median(apart))
        # Half the photosites agree exactly where a camera counts coarsely; the variance then shows more.
        spread = 1.4826 * float(np.median(np.abs(apart - middle)))
        inner = np.abs(apart - middle) < 4.0 * max(spread, 1e-12)
        spread = max(spread, float(apart[inner].std()) if inner.any() else 0.0)
        far[site] = np.abs(apart - middle) > SIGMAS * max(spread, 1e-9)
    return _joined(far, image.shape, tile)


def _joined(planes: Mask, shape: tuple[int, ...], tile: Period) -> Mask:
    """The planes of the CFA sites put together again; what completes no tile is False."""
    image = np.zeros(shape, bool)
    rows, columns = tile
    height, width = shape[0] // rows * rows, shape[1] // columns * columns
    for site, plane in enumerate(planes):
        image[site // columns : height : rows, site % columns : width : columns] = plane
    return image
