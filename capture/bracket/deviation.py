"""Distance of two exposures, and the threshold above which they differ."""

import math

from imaging.optics.exposure import Exposure

TOLERANCE_STOPS = 1 / 6
"""Half of the third of a stop that cameras are set in: more is another exposure, not rounding."""


def stops_apart(exposure: Exposure, other: Exposure) -> float:
    """Stops by which `one` is brighter than `other`.

    An f-number or ISO that only one of them states is left out: it is unknown, not different.
    """
    apart = math.log2(exposure.time / other.time)
    if exposure.iso is not None and other.iso is not None:
        apart += math.log2(exposure.iso / other.iso)
    if exposure.f_number is not None and other.f_number is not None:
        apart -= 2 * math.log2(exposure.f_number / other.f_number)
    return apart


def deviates(reported: Exposure | None, requested: Exposure | None) -> bool:
    """Return whether both are known and lie further apart than the tolerance."""
    if reported is None or requested is None:
        return False
    return abs(stops_apart(reported, requested)) > TOLERANCE_STOPS + 1e-9
