"""The tone curves of the simulated cameras that develop their own photographs.

film: a Naka-Rushton curve, `code = (1 + c) x^p / (x^p + c)`: a toe, a straight middle and a shoulder,
neither sRGB nor any gamma, and with an inverse in closed form. srgb: IEC 61966-2-1. gamma: a power. `x` is 1
where the code saturates.
"""

from typing import Literal

import numpy as np

from imaging.arrays import Array, Floats

Curve = Literal["film", "srgb", "gamma"]

POWER, KNEE = 1.12, 0.21
GAMMA = 1.8


def develop(x: Floats, curve: Curve = "film") -> Array:
    """Code value 0..1 of a relative exposure."""
    light = np.clip(np.asarray(x, np.float64), 0.0, 1.0)
    if curve == "srgb":
        return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    if curve == "gamma":
        return np.asarray(light ** (1.0 / GAMMA))
    raised = light**POWER
    return np.asarray((1.0 + KNEE) * raised / (raised + KNEE))


def exposure_of(code: Floats, curve: Curve = "film") -> Array:
    """The inverse: relative exposure of a code value 0..1."""
    value = np.asarray(code, np.float64)
    if curve == "srgb":
        return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    if curve == "gamma":
        return np.asarray(value**GAMMA)
    return np.asarray((value * KNEE / (1.0 + KNEE - value)) ** (1.0 / POWER))
