"""The scale of light in cd/m2: readings of meters and known lamps, and what they came to, as they are
recorded."""

import math
from typing import Self

from pydantic import Field, model_validator

from imaging.record import Record
from imaging.session.view_id import ViewText

Area = tuple[int, int, int, int]
"""Left, top, width and height, px of the file (of RAW, of its mosaic)."""


class LuminanceReading(Record):
    """Luminance of something in a picture, as stated by a meter or a data sheet.

    Either its luminance, or the illuminance on a matt surface and its reflectance, which make the luminance
    `E rho / pi`. Without an area it is of the colour chart that the session was calibrated by: an illuminance
    on it, or the luminance of its white patch.
    """

    view: ViewText | None = None
    area: Area | None = None
    luminance: float | None = Field(default=None, gt=0)
    """cd/m2."""
    illuminance: float | None = Field(default=None, gt=0)
    """lx."""
    reflectance: float | None = Field(default=None, gt=0, le=1)
    error: float = Field(gt=0, lt=1)
    """Relative standard error of what is stated, the reflectance's included."""
    source: str
    """Name of the source, whose error is common: the readings of one meter are wrong together, different
    lamps independently.
    """

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if (self.luminance is None) == (self.illuminance is None):
            raise ValueError("a reading is a luminance or an illuminance")
        if (self.view is None) != (self.area is None):
            raise ValueError("a view and an area in it belong together")
        if self.area is None and self.reflectance is not None:
            raise ValueError("the reflectances of a chart are published, and not to be given")
        if self.area is not None and (self.illuminance is None) != (self.reflectance is None):
            raise ValueError("an illuminance needs the reflectance of the surface, a luminance does not")
        if self.area is not None and (min(self.area[:2]) < 0 or min(self.area[2:]) < 1):
            raise ValueError("an area is left, top, width and height in pixels")
        return self

    def __str__(self) -> str:
        area = "" if self.area is None else f":{','.join(map(str, self.area))}"
        return f"{'chart' if self.view is None else self.view}{area}"

    def known(self, reflectance: float) -> float:
        """The luminance of a perfect white in its place, cd/m2; reflectance: of what was read off."""
        if self.luminance is not None:
            return self.luminance / reflectance
        assert self.illuminance is not None
        return self.illuminance / math.pi


class ReadingEvidence(Record):
    """One reading beside what the pictures show there."""

    reading: LuminanceReading
    views: tuple[ViewText, ...]
    """Views in which it was measured."""
    luminance: float
    """Stated luminance of the place, cd/m2: for a chart, that of a perfect white in its place."""
    light: float
    """Luminance of the place in the unit of the calibration's light, 0.2126 R + 0.7152 G + 0.0722 B."""
    light_error: float
    """Relative standard error of the light: noise, unevenness, exposure, response, falloff and aim."""
    shots_sha256: str
    """Hash over the shots of these views: with other shots the reading is stale."""
    residual: float
    """Natural log of the stated luminance over that of the scale."""


class LuminanceScale(Record):
    """Luminance scale of a calibration's light, cd/m2."""

    value: float = Field(gt=0)
    """cd/m2 of a place whose light is (1, 1, 1), linear Rec.709 in the unit of the calibration."""
    error: float = Field(gt=0)
    """Standard error, cd/m2."""
    cameras: tuple[str, ...]
    """Cameras to which it applies: read by themselves, or compared with one that was."""
    readings: tuple[ReadingEvidence, ...] = Field(min_length=1)

    def __str__(self) -> str:
        return f"{self.value:.4g} ± {self.error:.2g} cd/m²"
