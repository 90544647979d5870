"""Names of the arrays that everything computes with, by their type."""

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
"""Numbers that are computed with."""
Array32 = npt.NDArray[np.float32]
"""Pictures and their light."""
Floats = npt.NDArray[np.floating]
"""Numbers of either precision."""
Mask = npt.NDArray[np.bool_]
"""One yes or no for each pixel, point or view."""
Bytes = npt.NDArray[np.uint8]
"""Codes of 8 bits, and packed data."""
Integers = npt.NDArray[np.int64]
"""Indices and counts."""
AnyArray = npt.NDArray[Any]
"""Numbers of any type."""
