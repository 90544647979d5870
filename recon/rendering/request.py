"""Options that a user gives the pictures of a scene."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Annotated, Any

from imaging.choices import ExrStorage, Space
from imaging.errors import InputError
from imaging.request import Request
from recon.result.layer_names import Layer

if TYPE_CHECKING:
    from recon.rendering.cameras.camera_paths import CameraPath


FRAMES = 120
MOST_FRAMES = 100_000


@dataclass(frozen=True)
class RenderRequest(Request):
    """Options of renders: the command line, Python and the benches each make one.

    Raises:
        InputError: The path is neither a name nor there.
    """

    views: Annotated[
        Sequence[str] | None,
        "Names `frame/camera` of the views to draw. If not given, every view of the scene.",
    ] = None
    path: Annotated[
        "str | PathLike[str] | CameraPath | None",
        "Render a moving camera instead of the views: orbit or spline (with a number of frames, "
        "spline:240), or a file of cameras: transforms.json, a folder with a COLMAP model, CSV, USD.",
    ] = None
    path_in: Annotated[
        str | PathLike[str] | None,
        "The file of rig export (USD, glb, PLY) that defines the coordinates of the path, if the path does "
        "not state them, such as CSV from Blender or Nuke. [default: those of the calibration]",
    ] = None
    path_camera: Annotated[
        str | None,
        "Camera of a USD stage. [default: the first that rig export did not write, if any]",
    ] = None
    first_frame: Annotated[
        int | None, "Number of the first frame of a path. [default: as its file says, else 1001]"
    ] = None
    width: Annotated[
        int | None,
        "Width of the pictures, px. [default: that of the training, or of the path; 1024 for a probe]",
    ] = None
    space: Annotated[
        Space, "Primaries of the EXR files, which name them by colorInteropID; light is linear in all."
    ] = "rec709"
    exr: Annotated[
        ExrStorage,
        "Storage of the light in the EXR files: 32-bit floats; half, 16-bit floats; or dwaa, these with "
        "lossy compression. Layers stay 32-bit floats.",
    ] = "float"
    layers: Annotated[
        Sequence[Layer],
        "Data layers beside the light, in separate EXR parts: depth, alpha, normal, trust. Trust is the "
        "number of training views that saw a surface and measured its light.",
    ] = ()
    raw: Annotated[
        str | None,
        "Also write what the sensor of that camera would record: RAW (DNG) for each exposure of its bracket, "
        "with its colours, filters and noise.",
    ] = None
    stops: Annotated[Sequence[float], "A PNG for each of them: the light times 2^(exposure + stops)."] = (
        0.0,
    )
    exposure: Annotated[
        float | None,
        "The light times 2^STOPS, 0 for the light itself. If it is not given, the one exposure of the "
        "session counts, which rig merge has too; EXR state the factor as rig:exposureFactor.",
    ] = None
    shown: Annotated[
        Callable[..., Any] | None,
        "Tone map of the PNG, of linear light [H, W, 3] and a factor, uint8. If not given, light is clipped "
        "at white and encoded as sRGB.",
    ] = None
    hdr: Annotated[
        bool,
        "Also write each picture for HDR screens, to 4 stops above white: Ultra HDR JPEG and AVIF (PQ), and "
        "of a film two more, in HDR10 and HLG. Tone maps apply to what SDR screens show of the JPEG alone.",
    ] = False
    video: Annotated[bool, "Also write an MP4 of the PNG files, at the first of their stops."] = False
    rate: Annotated[float, "Frames per second of the MP4."] = 24.0

    def __post_init__(self) -> None:
        if isinstance(self.path, str | PathLike):
            check_path(self.path)


def named_frames(text: str) -> tuple[str, int] | None:
    """Parse `orbit`, `orbit:N`, `spline` or `spline:N` of N frames; None for any other. InputError for a bad
    N.
    """
    name, colon, count = text.partition(":")
    if name not in ("orbit", "spline"):
        return None
    if not colon:
        return name, FRAMES
    if not count.isdecimal() or not 1 <= int(count) <= MOST_FRAMES:
        raise InputError(f"{text!r} is not a path: write {name}:N, N frames from 1 to {MOST_FRAMES}.")
    return name, int(count)


def check_path(path: str | PathLike[str]) -> None:
    """InputError if a path is neither a name nor there."""
    if named_frames(str(path)) is None and not os.path.exists(path):
        raise InputError(
            f"{path} is not a path to render: write orbit:N, spline:N, or name transforms.json, a folder "
            "with a COLMAP model, a CSV table or a USD file."
        )
