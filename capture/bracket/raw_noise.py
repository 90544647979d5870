"""Noise model of a camera at any ISO: signal to noise, and clipping.

A signal is linear, black 0 and white 1: `signal = radiance * exposure.scale`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from imaging.arrays import Array
from imaging.merge.bracket import MARGIN
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from imaging.sensor.noise import SensorNoise

LEVELS, ENOUGH = 32, 200
"""Levels of signal at which the variance is estimated, and photosites that one needs."""
TRIM, TRIMMED = 0.95, 0.759
"""Share of the smallest squares of differences that count, since things move between takes, and their mean
where the noise is normal, over its variance: chi-squared of 3 and 1 degrees of freedom."""
LEAST_SLOPE = 1e-7
"""Least variance of the signal over the signal, where no light shows any: ten million electrons at white."""


def profile_of(pairs: Sequence[tuple[RawMosaic, RawMosaic]]) -> tuple[float, float]:
    """Estimate the noise of a camera whose files do not state it, from the differences of equal exposures.

    Args:
        pairs: Two takes each of what the camera sees.

    Returns:
        (S, O): the variance of a signal, 1 at white, is `S * signal + O`; O is no less than that of rounding.
    """
    levels, squares = [], []
    for one, other in pairs:
        valid = ~(one.saturated() | other.saturated())
        signals = [frame.signal().astype(np.float64)[valid] for frame in (one, other)]
        levels.append(0.5 * (signals[0] + signals[1]))
        squares.append(0.5 * (signals[0] - signals[1]) ** 2)
    level, square = np.concatenate(levels), np.concatenate(squares)
    frame = pairs[0][0]
    rounding = 1.0 / 12.0 / (frame.white - float(np.mean(frame.black))) ** 2
    if level.size < ENOUGH:
        return LEAST_SLOPE, rounding
    order = np.argsort(level, kind="stable")
    parts = np.array_split(order, max(1, min(LEVELS, level.size // ENOUGH)))
    means = np.array([max(float(level[part].mean()), 0.0) for part in parts])
    variances = np.array(
        [np.sort(square[part])[: math.ceil(TRIM * len(part))].mean() / TRIMMED for part in parts]
    )
    variances = np.maximum(variances, rounding)
    rows = np.column_stack([means, np.ones_like(means)]) / variances[:, None]
    (slope, floor), _ = nnls(rows, np.ones_like(means))
    return max(float(slope), LEAST_SLOPE), max(float(floor), rounding)


@dataclass(frozen=True)
class RawNoise:
    """The noise of a linear sensor, from which follows what an exposure is good for.

    sensor: at ISO 100, DN; span: DN from black to white. A higher ISO multiplies signal and read noise
    alike and leaves the rounding to whole DN, so that it helps only where rounding matters.
    """

    sensor: SensorNoise
    span: float

    @classmethod
    def of(cls, pairs: Sequence[tuple[RawMosaic, RawMosaic]]) -> "RawNoise":
        """Read the noise profile of frames, or estimate it where they have none.

        Args:
            pairs: Two takes of each exposure and position, of one camera at one ISO.
        """
        frame = pairs[0][0]
        profile = frame.noise_profile or profile_of(pairs)
        black = float(np.mean(frame.black))
        noise = SensorNoise.from_profile(profile, black, frame.white)
        shot_at = frame.metadata.exposure
        gain = noise.gain / (1.0 if shot_at is None else shot_at.iso_gain)
        return cls(noise.model_copy(update={"gain": gain}), frame.white - black)

    def profile(self, exposure: Exposure) -> tuple[float, float]:
        """(S, O): variance of the signal is `S * signal + O`."""
        gained = self.sensor.model_copy(update={"gain": self.sensor.gain * exposure.iso_gain})
        return gained.profile(0.0, self.span)

    def snrs(self, radiances: Array, exposure: Exposure) -> Array:
        """Signal to noise in dB, 20 log10, of positive radiances [n]. Clipping is ignored."""
        slope, floor = self.profile(exposure)
        signal = radiances * exposure.scale
        return np.asarray(20.0 * np.log10(signal / np.sqrt(slope * signal + floor)))

    def snr(self, radiance: float, exposure: Exposure) -> float:
        """The same of one radiance; -inf without light."""
        return float(self.snrs(np.array(radiance), exposure)) if radiance > 0 else -math.inf

    def darkest(self, snr: float, exposure: Exposure) -> float:
        """The radiance at which an exposure reaches `snr` dB: the root of `s^2 = r^2 (S s + O)`."""
        slope, floor = self.profile(exposure)
        ratio = math.pow(10.0, snr / 10.0)
        signal = (ratio * slope + math.sqrt((ratio * slope) ** 2 + 4.0 * ratio * floor)) / 2.0
        return signal / exposure.scale

    def brightest(self, exposure: Exposure) -> float:
        """The radiance whose signal stays MARGIN standard deviations below white.

        It is what the merge demands of a sample: the root of `(1 - s)^2 = m^2 (S s + O)` below 1.
        """
        slope, floor = self.profile(exposure)
        half = 1.0 + MARGIN**2 * slope / 2.0
        signal = half - math.sqrt(half**2 - 1.0 + MARGIN**2 * floor)
        return signal / exposure.scale
