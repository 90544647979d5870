"""Options that a user gives the export of a scene."""

from dataclasses import dataclass
from typing import Annotated, Literal

from imaging.request import Request

FormatName = Literal["usd", "sog", "glb", "spz", "spz4", "ply", "html", "points", "mesh", "cameras"]
ProgramName = Literal[
    "nuke", "blender", "houdini", "unreal", "arnold", "realitykit", "supersplat", "spark", "three", "babylon"
]


@dataclass(frozen=True)
class ExportRequest(Request):
    """Options of an export: the command line, Python and the benches each make one."""

    format: Annotated[FormatName | None, "Format to write, if the extension of FILE does not select it."] = (
        None
    )
    linear: Annotated[
        bool | None,
        "Linear light, or sRGB encoded for display, clipped at white. [default: what programs expect of the "
        "format; for .sog, sRGB extended above white]",
    ] = None
    exposure: Annotated[
        float | None,
        "Light is multiplied by 2^STOPS. If it is not given, the median of the scene is middle grey.",
    ] = None
    program: Annotated[
        ProgramName | None,
        "The program that opens the file: it picks the format and its light, and what was tried is printed.",
    ] = None
    albedo: Annotated[
        bool,
        "Write the albedo of each Gaussian, the irradiance that it follows from and its standard error, too, "
        "to light the scene anew (USD, linear PLY); not a number where they are not known.",
    ] = False
