"""Record of the coordinate system of a scene: a survey's, GPS, or another session's."""

import math
from typing import Literal

from pydantic import Field

from imaging.record import Record
from imaging.session.view_id import ViewText

Place = tuple[float, float, float]


def length_text(metres: float) -> str:
    """A length in the unit that it is easily read in."""
    return f"{1000 * metres:.3g} mm" if metres < 1 else f"{metres:.4g} m"


class PointMark(Record):
    """Image position of a surveyed point in a view."""

    view: ViewText
    at: tuple[float, float]
    """px of the file, the middle of the upper left pixel at (0.5, 0.5)."""
    detected: bool = False
    """Found as a marker in the picture, not clicked."""
    miss: tuple[float, float] | None = None
    """Distance to the projection of the surveyed position, px; None if the view has no pose."""


class SurveyedPoint(Record):
    """One point of a survey, and how well the scene fits it."""

    name: str
    position: Place
    """Position in the coordinates of the survey, m."""
    sigma: float | None = Field(default=None, gt=0)
    """Standard error of each coordinate as the survey states it, m."""
    marks: tuple[PointMark, ...] = ()
    miss: Place | None = None
    """Offset from the surveyed position to the scene's, m; None if the views do not triangulate the point."""
    used: bool = False
    """True if the point takes part in the alignment."""
    reason: str = ""
    """Reason why it does not."""

    @property
    def miss_m(self) -> float | None:
        """Distance between the scene's position and the surveyed one, m."""
        return None if self.miss is None else math.hypot(*self.miss)

    @property
    def miss_px(self) -> float | None:
        """Root mean square of the distances of its marks from its projections, px of the files."""
        squares = [sum(part**2 for part in mark.miss) for mark in self.marks if mark.miss is not None]
        return math.sqrt(sum(squares) / len(squares)) if squares else None

    def __str__(self) -> str:
        off, pixels = self.miss_m, self.miss_px
        residual = "" if pixels is None else f", {pixels:.3g} px in {len(self.marks)} images"
        place = "not placed" if off is None else f"{length_text(off)} off{residual}"
        why = f"; {self.reason}" if self.reason else ""
        return f"{self.name}: {place}{'' if self.used else ', not used'}{why}"


class CoordinateSystem(Record):
    """The coordinates of a calibration that are not its own, and how well it stands in them.

    What all lengths and poses are in is `system` less `offset`.
    """

    source: Literal["survey", "gps", "session"]
    """Source of the alignment: surveyed points, the positions in the photographs' EXIF, another session."""
    system: str
    """`local`, a projected one by its EPSG code, or east, north and up at `origin`."""
    offset: Place = (0.0, 0.0, 0.0)
    """Coordinates of the system are those of the calibration plus this: large numbers stand here, in double
    precision."""
    origin: Place | None = None
    """Origin of an east-north-up system: latitude and longitude, degrees, and height above the WGS84
    ellipsoid, m.
    """
    rms: float
    """RMS residual of what was used, in the calibration's unit: three coordinates together."""
    scale_error: float | None
    """Relative standard error of the scale; None if a board or measured camera positions gave the scale
    before.
    """
    rotation_error: float
    """About the worst axis, degrees."""
    position_error: float
    """Standard error at the middle of what was used, along the worst axis, in the calibration's unit."""
    used: int
    """Points, photographs or scene points that determine it."""
    left_out: int = 0
    """Outliers left out."""
    points: tuple[SurveyedPoint, ...] = ()
    onto: str | None = None
    """The folder of the session whose coordinates these are."""

    @property
    def described(self) -> str:
        """The system in words."""
        if self.origin is None and self.system == "local":
            return "those of the survey" if self.onto is None else f"those of {self.onto}"
        if self.origin is None:
            return self.system
        latitude, longitude, height = self.origin
        return f"east, north and up from {latitude:.5f}°, {longitude:.5f}°, {height:g} m (WGS84)"

    @property
    def less_offset(self) -> str:
        """The offset in words; empty without one."""
        return " less ({:.10g}, {:.10g}, {:.10g})".format(*self.offset) if any(self.offset) else ""

    @property
    def note(self) -> str:
        """Description in one line of ASCII, for headers of files."""
        words = f"{self.described}{self.less_offset}".replace("°", " degrees")
        return words.encode("ascii", "replace").decode()
