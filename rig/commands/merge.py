"""`rig merge`: brackets as linear EXR files."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from calib.exports import merge_session
from calib.exports.panorama import panorama as panoramas
from calib.exports.request import PanoramaRequest
from imaging.plates import merged_view
from imaging.session import calibration as calibrations
from rig.options.common import JsonOption, SessionArgument, WrongUsage
from rig.options.defaults import without_users
from rig.options.request import Asked, Shown
from rig.terminal import panorama_result as results
from rig.terminal.result import CommandResult, removed_on_failure, running
from rig.terminal.text import counted, number

NO_OPTIONS = PanoramaRequest()
OPTIONS = Asked(
    frame=Shown(how={"min": 0, "metavar": "N"}),
    camera=Shown(how={"metavar": "NAME"}),
    exposure=Shown(how={"min": -60, "max": 60, "metavar": "STOPS"}),
    width=Shown(how={"metavar": "PX"}),
    sun=Shown(how={"min": 0, "metavar": "LUX"}),
)


def merge(
    context: typer.Context,
    session: SessionArgument,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="The folder for the EXR files; the file of a panorama.")
    ],
    request: Annotated[PanoramaRequest, OPTIONS] = NO_OPTIONS,
    panorama: Annotated[
        bool,
        typer.Option(
            "--panorama",
            help="Merge views from one place (a nodal head, fisheyes of a rig) into OUT, one "
            "latitude-longitude EXR of all directions, in cd/m2 where the scale of light is known.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> CommandResult:
    """Merge brackets to linear EXR files.

    Writes OUT/FRAME/CAMERA.exr with light, its standard deviation and a mask. All files of a session share
    one scale, whichever part of it is merged: the light times the one factor of the session, which rig render
    and rig export have too. Headers (rig:exposureFactor) and OUT/merge.json state it, and light = value /
    factor; after rig calibrate --luminance, whiteLuminance in the header makes values absolute. Exposures and
    response are those of rig calibrate; without it, those of the files' labels, and sRGB. What a mask of the
    session hides in one exposure is taken from the others; what it hides in all of them is merged all the
    same, and sets the bit of value 16 in the mask. RAW of a camera without calibrated colour stays camera
    RGB.

    Example: rig merge S merged/ --frame 0
    """
    if panorama:
        with running("merge") as status, removed_on_failure(out, unless=Path.is_file):
            merged_map = panoramas.merge_panorama(session, out, request, on_progress=status)
        return results.panorama_result(session, merged_map, request.space)
    request = without_users(context, request, "width", "sun")
    if request.width is not None or request.sun is not None:
        raise WrongUsage("--width and --sun are for --panorama: add it, or leave them out", context)
    with (
        running("merge") as status,
        removed_on_failure(out, unless=lambda path: any(path.rglob("*.exr"))),
    ):
        merged = merge_session.merge(session, out, request, on_progress=status)
    return _merge_result(session, out, request, merged)


def _merge_result(
    session: Path, out: Path, request: PanoramaRequest, merged: "merge_session.Merged"
) -> CommandResult:
    calibration, factor = merged.calibration, merged.exposure_factor
    reused = sum(picture.reused for picture in merged.views)
    source = "labels (there is no calibration)" if calibration is None else "the calibration"
    lines = [f"{out}: {counted(len(merged.views), 'merged picture')}, exposures from {source}"]
    lines.append(_scale_line(factor, calibration, middle_grey=request.exposure is None))
    if reused:
        lines.append(f"{counted(reused, 'file')} of an earlier run kept")
    lines += [f"{picture.file}: {warning}" for picture in merged.views for warning in picture.warnings]
    uncoloured = _camera_rgb(merged)
    if uncoloured:
        known = calibration is not None
        lines.append(results.camera_rgb_line(session, uncoloured, request.space, calibrated=known))
    data = {
        "session": str(session),
        "exposures": "labels" if calibration is None else "calibration",
        "space": request.space,
        "exposure_factor": factor,
        "camera_rgb": uncoloured,
        "files": [_picture_data(picture) for picture in merged.views],
    }
    return CommandResult(data, lines, _missing(session, merged), usable=True)


def _scale_line(
    factor: float, calibration: "calibrations.CalibrationRecord | None", *, middle_grey: bool
) -> str:
    """Meaning of a value in the files."""
    stops = f"{math.log2(factor):+g}".replace("-", "−")
    why = ", the exposure of the session, which shows its median as middle grey" if middle_grey else ""
    values = f"Values are light times {number(factor)} ({stops} stops){why}"
    if calibration is None or calibration.luminance is None:
        return values
    scale = calibration.luminance
    white = f"{number(scale.value / factor)} ± {number(scale.error / factor, 2)} cd/m²"
    return f"{values}; a value of 1 is {white}, for {', '.join(scale.cameras)}"


def _camera_rgb(merged: "merge_session.Merged") -> list[str]:
    """Cameras whose RAW was merged without knowing their colour."""
    return list(dict.fromkeys(picture.view.camera for picture in merged.views if not picture.known_colour))


def _picture_data(picture: "merged_view.MergedView") -> dict[str, Any]:
    return {
        "file": str(picture.file),
        "camera": picture.view.camera,
        "frame": picture.view.frame,
        "exposures": picture.exposures,
        "clipped": picture.clipped,
        "dark": picture.dark,
        "ghost": picture.ghost,
        "hidden": picture.hidden,
        "shift_px": picture.shift,
        "reused": picture.reused,
        "warnings": list(picture.warnings),
    }


def _missing(session: Path, merged: "merge_session.Merged") -> str | None:
    """Brackets that hold no measured light at all."""
    blind = {
        "saturated all over: take shorter ones": [
            picture.view for picture in merged.views if picture.clipped >= 1.0
        ],
        "black all over: take longer ones": [picture.view for picture in merged.views if picture.dark >= 1.0],
    }
    parts = [
        f"every exposure of {', '.join(map(str, views))} is {cause}"
        for cause, views in blind.items()
        if views
    ]
    return f"{session}: {'; '.join(parts)}." if parts else None
