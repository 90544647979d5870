"""Options that a user gives a calibration."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Annotated, Literal

from calib.light.parts import LightPart
from imaging.request import Forget, Request

if TYPE_CHECKING:
    from imaging.session.luminance import LuminanceReading
    from imaging.session.records import Board

Part = Literal["sensor", "response", "colour", "poses", "luminance"]


@dataclass(frozen=True)
class CalibrationRequest(Request):
    """Options of a calibration: the command line, Python and the benches each make one."""

    only: Annotated[Part | None, "Redo only this part and keep the rest; all parts but poses need none."] = (
        None
    )
    board: Annotated["Board | None", "ChArUco board layout, if the session does not record it."] = None
    chart: Annotated[bool, "Measure colours by a ColorChecker that some views show."] = False
    luminance: Annotated[
        "Sequence[LuminanceReading] | Forget | None",
        "Readings of meters and lamps, which make the light absolute. Those of earlier runs stay if "
        "there are no new ones; none forgets them.",
    ] = None
    survey: Annotated[
        str | PathLike[str] | None,
        "Surveyed points: a table with name,x,y,z in metres (or easting,northing,height, or "
        "latitude,longitude,altitude) and sigma; they stay for later runs, none forgets them.",
    ] = None
    marks: Annotated[
        str | PathLike[str] | None,
        "Where images show surveyed points: a table with name,image,u,v in pixels.",
    ] = None
    markers: Annotated[
        str | None,
        "Markers that stand on surveyed points, called by their numbers: DICT_APRILTAG_36H11.",
    ] = None
    onto: Annotated[
        str | PathLike[str] | None,
        "Take the coordinates of a calibrated session that shows the same scene; they stay for later runs, "
        "none forgets it.",
    ] = None
    without: Annotated[
        Collection[LightPart] | None, "Leave out a part of what scene points show of light."
    ] = None
    keep_doubtful: Annotated[
        bool, "Keep views that others contradict about where they stand, with a warning that names them."
    ] = False
