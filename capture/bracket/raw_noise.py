"""Noise model of a camera at any ISO: signal to noise, and clipping.

A signal is linear, black 0 and white 1: `signal = radiance * exposure.scale`.
"""

import math
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array
from imaging.errors import CaptureError
from imaging.merge.bracket import MARGIN
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from imaging.sensor.noise import SensorNoise


@dataclass(frozen=True)
class RawNoise:
    """The noise of a linear sensor, from which follows what an exposure is good for.

    sensor: at ISO 100, DN; span: DN from black to white. A higher ISO multiplies signal and read noise
    alike and leaves the rounding to whole DN, so that it helps only where rounding matters.
    """

    sensor: SensorNoise
    span: float

    @classmethod
    def of(cls, frame: RawMosaic) -> "RawNoise":
        """Read the noise profile of a frame; CaptureError if it has none."""
        if frame.noise_profile is None:
            raise CaptureError(
                f"the frames of camera {frame.metadata.serial} do not say how noisy they are, so that no "
                "bracket can be planned: give the exposures yourself, as --bracket -4,0,4."
            )
        black = float(np.mean(frame.black))
        noise = SensorNoise.from_profile(frame.noise_profile, black, frame.white)
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
