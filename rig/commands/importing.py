"""`rig import`: make a session of photographs that exist."""

from pathlib import Path
from typing import Annotated

import typer

from capture.imports import photos as photographs
from capture.imports.request import ImportRequest
from imaging.session.paths import has_shots
from rig.options.common import JsonOption
from rig.options.request import Asked, Shown
from rig.report.pages import calibration as calibration_page
from rig.terminal.result import CommandResult, missing_parts, removed_on_failure, running
from rig.terminal.text import command_line, counted

NO_OPTIONS = ImportRequest()
OPTIONS = Asked(bracket=Shown(how={"min": 1, "metavar": "N"}))


def importing(
    photos: Annotated[
        Path,
        typer.Argument(
            metavar="PHOTOS",
            help="Folder of RAW, JPEG, HEIC, WebP, PNG, TIFF, EXR or HDR files; or scene of nerfstudio, "
            "COLMAP, LLFF, HDR-NeRF, HDR-Pretrain, RawNeRF, RealX3D or OpenScan3; or a video.",
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The session folder to make.")],
    request: Annotated[ImportRequest, OPTIONS] = NO_OPTIONS,
    as_json: JsonOption = False,
) -> CommandResult:
    """Make a session of photographs.

    Copies the photographs and sorts them into cameras, frames and brackets by their metadata;
    every guess is listed. Lenses, poses and scene points of a nerfstudio, COLMAP, LLFF, HDR-NeRF,
    HDR-Pretrain, RawNeRF or RealX3D folder are kept, so that it can be reconstructed without rig calibrate.

    Example: rig import photos/ S
    """
    with running("import") as status, removed_on_failure(out, unless=has_shots):
        result = photographs.import_photos(photos, out, request, on_progress=status)
        if result.views:
            calibration_page.calibration_report(out, on_progress=status)
    lines = [
        f"{out}: {counted(result.shots, 'photo')} as {counted(result.frames, 'frame')} "
        f"of {counted(result.cameras, 'camera')}"
    ]
    lines += [f"  {guess}" for guess in result.guesses]
    if result.views:
        lines.append(f"{counted(result.views, 'view')} with a pose that was given, not measured")
        response = command_line("rig", "calibrate", out, "--only", "response")
        lines.append(f"Next: {command_line('rig', 'reconstruct', out)}, or first {response}")
    else:
        lines.append(f"Next: {command_line('rig', 'calibrate', out)}")
    data = {
        "session": str(out),
        "layout": result.layout,
        "cameras": result.cameras,
        "frames": result.frames,
        "shots": result.shots,
        "views_with_pose": result.views,
        "guesses": list(result.guesses),
        "missing_photos": list(result.missing),
    }
    return CommandResult(data, lines, missing_parts(result.require_complete), usable=result.shots > 0)
