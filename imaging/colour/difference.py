"""Colour differences: CIE Lab and CIEDE2000."""

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array
from imaging.colour.spaces import XYZ_FROM_REC709


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
    (l1, a1, b1), (l2, a2, b2) = (np.moveaxis(np.asarray(side, np.float64), -1, 0) for side in (one, other))
    seventh = ((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2) ** 7
    stretch = 1 + 0.5 * (1 - np.sqrt(seventh / (seventh + 25.0**7)))
    a1, a2 = a1 * stretch, a2 * stretch
    c1, c2 = np.hypot(a1, b1), np.hypot(a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    grey = c1 * c2 == 0
    turn = np.where(grey, 0.0, (h2 - h1 + 180) % 360 - 180)
    # Opposite hues have two means; the standard takes that of the angles as they are.
    far = np.abs(h1 - h2) > 180
    middle = (h1 + h2) / 2 + np.where(far, np.where(h1 + h2 < 360, 180.0, -180.0), 0.0)
    hue = np.radians(np.where(grey, h1 + h2, middle))
    chroma, light = (c1 + c2) / 2, (l1 + l2) / 2
    weight = (
        1
        - 0.17 * np.cos(hue - np.radians(30))
        + 0.24 * np.cos(2 * hue)
        + 0.32 * np.cos(3 * hue + np.radians(6))
        - 0.20 * np.cos(4 * hue - np.radians(63))
    )
    off = (light - 50) ** 2
    dl = (l2 - l1) / (1 + 0.015 * off / np.sqrt(20 + off))
    dc = (c2 - c1) / (1 + 0.045 * chroma)
    dh = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn) / 2) / (1 + 0.015 * chroma * weight)
    power = chroma**7
    blue = np.exp(-(((np.degrees(hue) - 275) / 25) ** 2))
    rotation = -2 * np.sqrt(power / (power + 25.0**7)) * np.sin(np.radians(60 * blue))
    return np.asarray(np.sqrt(np.maximum(dl**2 + dc**2 + dh**2 + rotation * dc * dh, 0.0)))
