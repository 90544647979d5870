"""Gain and read noise by photon transfer (EMVA 1288 release 4): variance in time against the mean.

The variance of a linear sensor is `K (mean - black) + (K read)^2 + 1/12`. A fixed pattern does not show
in it, since every photosite is compared with itself; light that falls off does not matter, since
averages over a tile obey the same line.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array, Floats, Mask

QUANTISATION = 1.0 / 12.0
"""DN^2; holds once the scatter before rounding is above some 0.4 DN."""
SMALLEST = 0.22
"""DN^2: below this variance rounding is not independent of what is rounded (error above 1 %)."""
HIGHEST = 0.7
"""Level of the ceiling above which photosites are left out (EMVA 1288): there the variance sinks."""


@dataclass(frozen=True, eq=False)
class Points:
    """Levels of a photon transfer curve; float64 [N].

    light: mean above black, DN; variance: DN^2; freedom: degrees of freedom of the variance.
    """

    light: Array
    variance: Array
    freedom: Array

    @classmethod
    def joined(cls, parts: Sequence["Points"]) -> "Points":
        """All points of some curves."""
        return cls(
            np.concatenate([part.light for part in parts]),
            np.concatenate([part.variance for part in parts]),
            np.concatenate([part.freedom for part in parts]),
        )

    def straightened(self, share: float) -> "Points":
        """The points of a sensor with a signal of `light (1 - share light)`, as a straight one has them."""
        slope = 1.0 + 2.0 * share * self.light
        light = self.light * (1.0 + share * self.light)
        return Points(light, self.variance * slope**2, self.freedom)

    def part(self, keep: Mask) -> "Points":
        """The points that `keep` [N] selects."""
        return Points(self.light[keep], self.variance[keep], self.freedom[keep])


@dataclass(frozen=True, eq=False)
class Transfer:
    """gain: K, DN per electron; floor: variance without light, DN^2; covariance [2, 2] of both."""

    gain: float
    floor: float
    covariance: Array

    def read_noise(self) -> tuple[float, float]:
        """Electrons, rounding taken out, and its standard error; 0 where the floor is all rounding."""
        dark = max(self.floor - QUANTISATION, 0.0)
        value = float(np.sqrt(dark)) / self.gain
        # Below its own error the square root has no slope of use.
        scale = max(dark, float(np.sqrt(self.covariance[1, 1])))
        slope = np.array((-value / self.gain, 0.5 / (np.sqrt(scale) * self.gain)))
        return value, float(np.sqrt(slope @ self.covariance @ slope))


def fit(points: Points) -> Transfer | None:
    """Fit the line through the points by weighted least squares; None where they do not determine a slope.

    Weights are of the fitted variances, not of the measured ones, which would pull the line down.
    """
    good = (points.variance > SMALLEST) & (points.freedom > 0)
    points = points.part(good)
    if len(points.light) < 3:
        return None
    design = np.stack([points.light, np.ones_like(points.light)], axis=1)
    expected: Array = np.maximum(points.variance, SMALLEST)
    values = np.zeros(2)
    inverse: Floats = np.eye(2)
    for _ in range(8):
        weight = points.freedom / (2.0 * expected**2)
        normal = design.T @ (design * weight[:, None])
        if np.linalg.cond(normal * np.outer(*[1 / np.sqrt(np.diag(normal))] * 2)) > 1e8:
            return None
        inverse = np.linalg.inv(normal)
        values = inverse @ (design.T @ (weight * points.variance))
        expected = np.maximum(design @ values, SMALLEST)
    if not values[0] > 0 or values[0] < 5 * np.sqrt(inverse[0, 0]):
        return None
    whitened = (points.variance - design @ values) ** 2 * points.freedom / (2.0 * expected**2)
    excess = max(float(whitened.sum()) / max(len(whitened) - 2, 1), 1.0)
    return Transfer(float(values[0]), float(values[1]), np.asarray(inverse * excess, np.float64))
