"""The tone curve of the simulated cameras that develop their own photographs.

A Naka-Rushton curve, `code = (1 + c) x^p / (x^p + c)`: a toe, a straight middle and a shoulder, neither sRGB
nor any gamma, and with an inverse in closed form. `x` is 1 where the code saturates.
"""

import numpy as np
import numpy.typing as npt

POWER, KNEE = 1.12, 0.21


def develop(x: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Code value 0..1 of a relative exposure."""
    raised = np.clip(np.asarray(x, np.float64), 0.0, 1.0) ** POWER
    return np.asarray((1.0 + KNEE) * raised / (raised + KNEE))


def exposure_of(code: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """The inverse: relative exposure of a code value 0..1."""
    value = np.asarray(code, np.float64)
    return np.asarray((value * KNEE / (1.0 + KNEE - value)) ** (1.0 / POWER))
