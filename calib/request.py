"""Options that a user gives a calibration."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Annotated, Literal

from imaging.request import Forget, Request

if TYPE_CHECKING:
    from imaging.session.luminance import LuminanceReading
    from imaging.session.records import Board

Part = Literal["sensor", "response", "colour", "poses", "luminance"]
LightPart = Literal["exposure", "white_balance", "falloff", "gain"]
"""Parts of the light that scene points determine: exposure of each photograph, beside its label; white
balance of each photograph, and between the cameras of a rig; falloff towards the corners; sensitivities of
the cameras."""
ASKED = "left out, as was asked"


@dataclass(frozen=True)
class CalibrationRequest(Request):
    """Options of a calibration: the command line, Python and the benches each make one."""

    only: Annotated[
        Part | None, "Redo only this part and keep the rest; all parts except poses work without poses."
    ] = None
    board: Annotated["Board | None", "ChArUco board layout, if the session does not record it."] = None
    chart: Annotated[bool, "Calibrate colour from a ColorChecker visible in some views."] = False
    luminance: Annotated[
        "Sequence[LuminanceReading] | Forget | None",
        "Readings of meters and lamps, which make the light absolute. Without new readings, those of earlier "
        "runs are kept; none discards them.",
    ] = None
    survey: Annotated[
        str | PathLike[str] | None,
        "Surveyed points: a table with name,x,y,z in metres (or easting,northing,height, or "
        "latitude,longitude,altitude) and sigma; kept for later runs, none discards them.",
    ] = None
    marks: Annotated[
        str | PathLike[str] | None,
        "Positions of surveyed points in images: a table with name,image,u,v in pixels.",
    ] = None
    markers: Annotated[
        str | None,
        "Dictionary of markers on surveyed points, named by their numbers: DICT_APRILTAG_36H11.",
    ] = None
    onto: Annotated[
        str | PathLike[str] | None,
        "Use the coordinates of a calibrated session of the same scene; kept for later runs, none discards "
        "them.",
    ] = None
    without: Annotated[
        Collection[LightPart] | None, "Switch off a photometric correction estimated from scene points."
    ] = None
    keep_doubtful: Annotated[
        bool, "Keep views whose poses other views contradict, with a warning that names them."
    ] = False
