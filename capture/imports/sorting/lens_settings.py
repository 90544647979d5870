"""Lens settings of a body: another focal length, lens or digital zoom is another lens to a calibration."""

from collections.abc import Sequence
from dataclasses import dataclass

from imaging.sensor.mosaic import FrameMetadata

SAME_FOCAL = 0.005
"""Relative difference of two focal lengths that are still one: files round them."""
ROUNDED = 1.0
"""Millimetres by which the 35 mm equivalents of one setting differ at most, as whole numbers."""


@dataclass(frozen=True)
class LensSetting:
    """Lens metadata of a file, None if absent.

    focal: mm, times the digital zoom. equivalent: mm of 35 mm film.
    """

    lens: str = ""
    focal: float | None = None
    equivalent: float | None = None

    def __str__(self) -> str:
        return self.short if not self.lens or self.short == self.lens else f"{self.lens}, {self.short}"

    @property
    def short(self) -> str:
        """Its focal length in words, else its name."""
        if self.focal is not None:
            return f"{self.focal:.3g} mm"
        return self.lens if self.equivalent is None else f"{self.equivalent:g} mm of 35 mm film"

    @property
    def known(self) -> bool:
        """True if the files state anything about the lens."""
        return bool(self.lens or self.focal or self.equivalent)

    def agrees(self, other: "LensSetting") -> bool:
        """Return whether both are one setting; what one of them does not say is no difference."""
        if self.lens and other.lens and self.lens != other.lens:
            return False
        if self.focal and other.focal and abs(self.focal / other.focal - 1) > SAME_FOCAL:
            return False
        if not (self.equivalent and other.equivalent):
            return True
        rounded = ROUNDED if self.focal and other.focal else 0.0
        return abs(self.equivalent - other.equivalent) <= rounded


UNKNOWN = LensSetting()


def setting_of(metadata: FrameMetadata) -> LensSetting:
    """Return what a file says of its lens."""
    focal = metadata.focal_length_mm
    zoomed = None if focal is None else focal * max(metadata.digital_zoom or 1.0, 1.0)
    return LensSetting(metadata.lens.strip(), zoomed, metadata.focal_length_35mm)


def lens_settings(files: Sequence[FrameMetadata]) -> list[LensSetting]:
    """The lens setting of each file of one body.

    Settings that agree are the first of them. Files that say nothing have the only setting there is, if there
    is one alone; else they are of a lens of their own, which is unknown.
    """
    settings = [setting_of(metadata) for metadata in files]
    distinct: list[LensSetting] = []
    for setting in sorted(settings, key=_order):
        if setting.known and not any(setting.agrees(other) for other in distinct):
            distinct.append(setting)
    if len(distinct) < 2:
        return [*distinct, UNKNOWN][:1] * len(settings)
    return [next((other for other in distinct if other.agrees(s)), s) if s.known else s for s in settings]


def _order(setting: LensSetting) -> tuple[bool, float, float, str]:
    """Sort the most complete first, by focal length."""
    return setting.focal is None, setting.focal or 0.0, setting.equivalent or 0.0, setting.lens
