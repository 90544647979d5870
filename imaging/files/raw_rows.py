"""Mosaics whose rows were exposed or amplified by turns, as Magic Lantern's Dual ISO has them."""

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array
from imaging.sensor.mosaic import RawMosaic

_HIGH, _WIDE = 8, 16
"""Photosites of one colour in a block, rows and columns."""
_MOST = 32
"""Number of rows of blocks examined, spread over the picture."""
_FEWEST = 16
"""Blocks with light below which nothing is concluded."""
_LIT, _FLOOR = 0.02, 0.002
"""Shares of the range: a block above the first is lit; values below the second are raised to it."""
_CLEAR = 0.4
"""Stops beyond which a block differs."""
_ALIKE = 0.9
"""Share of the blocks that have to differ the same way. No scene is striped like that: its stripes would
have to be four rows apart from edge to edge, in every colour."""


def row_stops(mosaic: RawMosaic) -> float:
    """Stops by which every other pair of rows, or row of a mono mosaic, is brighter; 0 where none is."""
    if mosaic.cfa is None or not (mosaic.cfa.bayer or mosaic.cfa.mono):
        return 0.0
    step = 1 if mosaic.cfa.mono else 2
    black = np.array(mosaic.black, np.float64)
    medians = []
    for row, column in np.ndindex(step, step):
        level = float(black[row % len(black), column % len(black[0])])
        plane = mosaic.pixels[row::step, column::step]
        stops = _stops(plane, level, mosaic.white - level)
        if len(stops) < _FEWEST:
            return 0.0
        median = float(np.median(stops))
        if np.mean(stops * np.sign(median) > _CLEAR) < _ALIKE:
            return 0.0
        medians.append(median)
    return float(np.mean(np.abs(medians))) if len({np.sign(median) for median in medians}) == 1 else 0.0


def _stops(plane: npt.NDArray[np.uint16], black: float, span: float) -> Array:
    """Log2 of even over odd rows for each lit block of one colour, float64 [N]."""
    even, odd = (_blocks(plane[first::2], black, span) for first in (0, 1))
    count = min(len(even), len(odd))
    even, odd = even[:count], odd[:count]
    lit = np.maximum(even, odd) > _LIT
    return np.asarray(np.log2(np.maximum(even[lit], _FLOOR) / np.maximum(odd[lit], _FLOOR)))


def _blocks(rows: npt.NDArray[np.uint16], black: float, span: float) -> Array:
    """Mean signal of blocks, 0..1, float64 [rows, columns], of `_MOST` rows of them at most."""
    high, wide = len(rows) // _HIGH, rows.shape[1] // _WIDE
    cut = rows[: high * _HIGH, : wide * _WIDE].reshape(high, _HIGH, wide, _WIDE)[:: max(1, -(-high // _MOST))]
    return np.asarray((cut.mean((1, 3), dtype=np.float64) - black) / span)
