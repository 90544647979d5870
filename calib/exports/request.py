"""Options that a user gives the merging of brackets."""

from dataclasses import dataclass
from typing import Annotated

from imaging.choices import ExrStorage, Space
from imaging.request import Request


@dataclass(frozen=True)
class MergeRequest(Request):
    """Options of a merge: the command line, Python and the benches each make one."""

    frame: Annotated[int | None, "Only the frame of this number."] = None
    camera: Annotated[str | None, "Only this camera."] = None
    space: Annotated[Space, "Primaries of the EXR files (written to the header); light is linear in all."] = (
        "rec709"
    )
    exr: Annotated[
        ExrStorage,
        "Storage of the light: 32-bit floats; half, 16-bit floats; or dwaa, these with lossy compression. "
        "Standard deviation and mask stay 32-bit floats.",
    ] = "float"
    exposure: Annotated[
        float | None,
        "Values are the light times 2^STOPS, 0 for the light itself. If it is not given, the one exposure of "
        "the session counts, which shows its median as middle grey; renders have it too.",
    ] = None


@dataclass(frozen=True)
class PanoramaRequest(MergeRequest):
    """Options of a merge into one map of all directions."""

    width: Annotated[
        int | None,
        "With --panorama: its columns, twice its rows. [default: as fine as views, 4096 at most]",
    ] = None
    sun: Annotated[
        float | None,
        "With --panorama: the illuminance of a card that faces the sun, which gives the light of what every "
        "exposure saturates.",
    ] = None
