"""The sensor noise model that capture, calibration, merge and training share (EMVA 1288 terms)."""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from imaging.arrays import Floats


class SensorNoise(BaseModel):
    """Noise of a linear sensor.

    gain: K, DN per electron, at the ISO of the shots; read_noise: electrons; prnu: relative.
    Variance at a mean signal of S DN above black (EMVA 1288 release 4, linear model):
    `(K read)^2 + 1/12 + K S + (prnu S)^2`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    gain: float = Field(gt=0)
    read_noise: float = Field(ge=0)
    prnu: float = Field(default=0.0, ge=0)

    def variance(self, signal: Floats) -> Floats:
        """Variance in DN^2 where the mean signal above black is `signal` DN (negative counts as 0)."""
        level = np.maximum(signal, 0.0)
        floor = (self.gain * self.read_noise) ** 2 + 1.0 / 12.0
        return np.asarray(floor + self.gain * level + (self.prnu * level) ** 2)

    def profile(self, black: float, white: float) -> tuple[float, float]:
        """(S, O) of a DNG NoiseProfile, on the signal in 0..1: variance = S * signal + O."""
        span = white - black
        return self.gain / span, ((self.gain * self.read_noise) ** 2 + 1.0 / 12.0) / span**2

    @classmethod
    def from_profile(cls, profile: tuple[float, float], black: float, white: float) -> "SensorNoise":
        """The inverse of `profile`; quantisation is taken out of the offset again."""
        span = white - black
        gain = profile[0] * span
        read = np.sqrt(max(profile[1] * span**2 - 1.0 / 12.0, 0.0)) / gain
        return cls(gain=gain, read_noise=float(read))
