"""Conversion of a lens with radial terms to the nearest fisheye, and the choice of lenses that may be one."""

import math

import numpy as np

from imaging.optics.lens import Lens

LEAST_RADIUS = 0.9
"""Focal lengths from the principal point to a corner, below which a lens is no fisheye: 42 degrees of an
undistorted lens, 52 of an equidistant one. So near to the axis, radial terms do as well; main cameras of
telephones, 24 mm by their labels, reach 0.87."""
_BEFORE_FOLD = 0.9


def may_be_fisheye(lens: Lens) -> bool:
    """Return whether an image reaches far enough from the axis for the terms of a fisheye to be tried."""
    wide, high = max(lens.cx, lens.width - lens.cx) / lens.fx, max(lens.cy, lens.height - lens.cy) / lens.fy
    return math.hypot(wide, high) > LEAST_RADIUS


def nearest_terms(k1: float, k2: float, radius: float) -> tuple[float, float, float, float]:
    """k1 to k4 of the fisheye that is nearest to r (1 + k1 r^2 + k2 r^4), r = tan(theta), out to `radius`.

    radius: in focal lengths, of the image's corner. Two terms are fitted, and the others 0: this is where an
    adjustment begins. Radial terms that fold over before the corner say nothing of what lies beyond.
    """
    angles = np.linspace(0.0, math.radians(80.0), 400)[1:]
    tangent = np.tan(angles)
    bent = tangent * (1 + tangent**2 * (k1 + tangent**2 * k2))
    falls = np.flatnonzero(np.diff(bent, prepend=0.0) <= 0)
    last = int(_BEFORE_FOLD * falls[0]) if len(falls) else len(angles)
    usable = (np.arange(len(angles)) < last) & (bent <= radius)
    if usable.sum() < 2:
        return 0.0, 0.0, 0.0, 0.0
    angles, bent = angles[usable], bent[usable]
    powers = np.stack([angles**3, angles**5], axis=1)
    first, second = np.linalg.lstsq(powers, bent - angles, rcond=None)[0].tolist()
    return first, second, 0.0, 0.0
