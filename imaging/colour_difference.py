"""Colour differences: CIE Lab and CIEDE2000."""

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array
from imaging.colour import XYZ_FROM_REC709


def lab(rgb: npt.ArrayLike) -> Array:
    """CIE Lab under D65 of linear Rec.709 [..., 3]; CIE 15, its straight part continued below black."""
    white = XYZ_FROM_REC709.sum(axis=1)
    ratio = np.asarray(rgb, np.float64) @ (XYZ_FROM_REC709 / white[:, None]).T
    root = np.where(ratio > 216 / 24389, np.cbrt(np.maximum(ratio, 1e-9)), (24389 / 27 * ratio + 16) / 116)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def delta_e(one: npt.ArrayLike, other: npt.ArrayLike) -> Array:
    """CIEDE2000 between linear Rec.709 colours [..., 3], white being (1, 1, 1)."""
    return ciede2000(lab(one), lab(other))


def ciede2000(one: npt.ArrayLike, other: npt.ArrayLike) -> Array:
    """CIEDE2000 between CIE Lab colours [..., 3], its three weights 1 (Sharma, Wu, Dalal 2005)."""
    from colour.difference import delta_E_CIE2000  # takes a second, needed where colours are compared only

    return np.asarray(delta_E_CIE2000(np.asarray(one, np.float64), np.asarray(other, np.float64)), np.float64)
