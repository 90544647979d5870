"""Exposure: time, f-number and ISO folded into one scale."""

import math
from typing import Self

from pydantic import BaseModel, ConfigDict, Field


class Exposure(BaseModel):
    """Settings of one exposure, as ordered or as the camera reports them.

    `time` in seconds, `f_number` dimensionless, `iso` arithmetic ISO speed. An f-number or ISO
    that is not known is None and counts as 1 and as ISO 100: it then has to be the same in every shot.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    time: float = Field(gt=0)
    f_number: float | None = Field(default=None, gt=0)
    iso: float | None = Field(default=None, gt=0)

    @property
    def iso_gain(self) -> float:
        """Gain relative to ISO 100."""
        return 1.0 if self.iso is None else self.iso / 100.0

    @property
    def scale(self) -> float:
        """`k = iso_gain * time / f_number**2`, in seconds: signal = scene irradiance * k."""
        return self.iso_gain * self.time / (1.0 if self.f_number is None else self.f_number**2)

    @property
    def stops(self) -> float:
        """log2 of the scale."""
        return math.log2(self.scale)

    def with_time(self, time: float) -> Self:
        """The same exposure with another time, in seconds."""
        return self.model_copy(update={"time": time})

    def __str__(self) -> str:
        time = f"{self.time:.3g} s" if self.time >= 0.4 else f"1/{1 / self.time:.0f} s"
        aperture = "" if self.f_number is None else f" f/{self.f_number:g}"
        return time + aperture + ("" if self.iso is None else f" ISO {self.iso:g}")
