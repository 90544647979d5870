"""In which coordinates a scene stands: a survey's, those of GPS, or another session's; as it is recorded."""

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
    """Where a view shows a surveyed point."""

    view: ViewText
    at: tuple[float, float]
    """px of the file, the middle of the upper left pixel at (0.5, 0.5)."""
    detected: bool = False
    """Found as a marker in the picture, not clicked."""
    miss: tuple[float, float] | None = None
    """From there to where the calibration projects the surveyed position, px; None: the view has no pose."""


class SurveyedPoint(Record):
    """One point of a survey, and how well the scene fits it."""

    name: str
    position: Place
    """In the coordinates of the survey, m."""
    sigma: float | None = Field(default=None, gt=0)
    """Standard error of each coordinate as the survey states it, m."""
    marks: tuple[PointMark, ...] = ()
    miss: Place | None = None
    """From the surveyed position to where the scene has the point, m; None: the views do not place it."""
    used: bool = False
    """Whether it tells where the scene is."""
    reason: str = ""
    """Why it does not."""

    @property
    def miss_m(self) -> float | None:
        """How far the scene has it from where it was surveyed, m."""
        return None if self.miss is None else math.hypot(*self.miss)

    @property
    def miss_px(self) -> float | None:
        """Root mean square of the distances of its marks from its projections, px of the files."""
        squares = [sum(part**2 for part in mark.miss) for mark in self.marks if mark.miss is not None]
        return math.sqrt(sum(squares) / len(squares)) if squares else None

    def __str__(self) -> str:
        off, pixels = self.miss_m, self.miss_px
        seen = "" if pixels is None else f", {pixels:.3g} px in {len(self.marks)} images"
        found = "not placed" if off is None else f"{length_text(off)} off{seen}"
        why = f"; {self.reason}" if self.reason else ""
        return f"{self.name}: {found}{'' if self.used else ', not used'}{why}"


class CoordinateSystem(Record):
    """The coordinates of a calibration that are not its own, and how well it stands in them.

    What all lengths and poses are in is `system` less `offset`.
    """

    source: Literal["survey", "gps", "session"]
    """What placed it: surveyed points, the positions in the photographs' EXIF, another session."""
    system: str
    """`local`, a projected one by its EPSG code, or east, north and up at `origin`."""
    offset: Place = (0.0, 0.0, 0.0)
    """Coordinates of the system are those of the calibration plus this: large numbers stand here, in double
    precision."""
    origin: Place | None = None
    """Of an east-north-up system, where its zero is: latitude and longitude, degrees, and height above the
    WGS84 ellipsoid, m."""
    rms: float
    """Of the misses of what was used, in the calibration's unit: three coordinates together."""
    scale_error: float | None
    """Standard errors: of the scale, relative; None: a board or measured places of cameras told it before."""
    rotation_error: float
    """About the worst axis, degrees."""
    position_error: float
    """Of the middle of what was used, along the worst axis, in the calibration's unit."""
    used: int
    """Points, photographs or scene points that tell it."""
    left_out: int = 0
    """Those that do not fit."""
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
        """The offset in words; empty where it is none."""
        return " less ({:.10g}, {:.10g}, {:.10g})".format(*self.offset) if any(self.offset) else ""

    @property
    def note(self) -> str:
        """What they are in one line of ASCII, as headers of files have it."""
        words = f"{self.described}{self.less_offset}".replace("°", " degrees")
        return words.encode("ascii", "replace").decode()
