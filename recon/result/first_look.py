"""The look that a scene begins with, in `rig view` and on the page of `rig export`: stops and tones."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from imaging.files.photo import is_photo

MOST_STOPS = 16.0
"""Range in which a page makes light brighter or darker, stops."""


class Beginning(NamedTuple):
    """stops: brighter than what shows the scene's median as middle grey; tones: name of the tone map."""

    stops: float
    tones: Literal["linear", "AgX"]


def beginning(exposure: float, shot_at: float | None) -> Beginning:
    """Return the look that a scene begins with: that of its photographs where these are developed, else AgX.

    exposure: factor that shows its median as middle grey; shot_at: result of `shot_at`.
    """
    if shot_at is None:
        return Beginning(0.0, "AgX")
    return Beginning(round(min(max(math.log2(shot_at / exposure), -MOST_STOPS), MOST_STOPS), 1), "linear")


def shot_at(shots: Sequence[Sequence[tuple[str, float]]]) -> float | None:
    """Return the median factor from light to the signal of the photographs, whose white is 1.

    shots: file and factor of the shots of each view. None where a view has several photographs, or RAW or
    EXR: no single one shows all its light, and no tones were chosen for it.
    """
    if not shots or any(len(one) != 1 or not is_photo(Path(one[0][0])) for one in shots):
        return None
    return float(np.median([factor for ((_, factor),) in shots]))
