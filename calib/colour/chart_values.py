"""The classic chart of 24 patches."""

from functools import cache

import numpy as np

from imaging.arrays import Array
from imaging.colour.spaces import PRIMARIES, REC709_FROM_XYZ, adaptation

PATCHES = 24
COLUMNS = 6
NEUTRAL = tuple(range(18, 24))
"""The row of greys, white first."""
EDITION = "ColorChecker24 - After November 2014"
"""Edition of the reference values, as X-Rite published them for charts made since then; those made before
differ by 0.85 delta E 2000 in the mean, 2.0 at most.
"""


@cache
def chart() -> Array:
    """Linear Rec.709 of the patches under D65, float64 [24, 3], a perfect diffuser being (1, 1, 1).

    Published under D50, and adapted by Bradford's matrix.
    """
    import colour  # takes a second, needed with a chart only

    edition = colour.CCS_COLOURCHECKERS[EDITION]
    xyz = np.array([colour.xyY_to_XYZ(patch) for patch in edition.data.values()])
    x, y = (float(part) for part in edition.illuminant)
    return np.asarray(xyz @ (REC709_FROM_XYZ @ adaptation((x, y), PRIMARIES["rec709"][3])).T, np.float64)
