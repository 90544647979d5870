"""Options that a user gives the export of a scene."""

from dataclasses import dataclass
from typing import Annotated, Literal

from imaging.request import Request

FormatName = Literal["usd", "sog", "glb", "spz", "ply", "html", "points", "mesh", "cameras"]
ProgramName = Literal[
    "nuke", "blender", "houdini", "unreal", "arnold", "realitykit", "supersplat", "spark", "three"
]


@dataclass(frozen=True)
class ExportRequest(Request):
    """Options of an export: the command line, Python and the benches each make one."""

    format: Annotated[FormatName | None, "What to write, where the suffix of FILE does not name it."] = None
    linear: Annotated[
        bool | None,
        "Linear light, or sRGB as displays show it, clipped at white. [default: what programs expect of the "
        "format; of .sog sRGB that goes on above white]",
    ] = None
    exposure: Annotated[
        float | None,
        "Light is multiplied by 2^STOPS. If it is not given, the median of the scene is middle grey.",
    ] = None
    program: Annotated[
        ProgramName | None,
        "The program that opens the file: it picks the format and its light, and what was tried is printed.",
    ] = None
