"""`rig import`: make a session of photographs that exist."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from imaging.session.paths import has_shots
from rig.options.common import JsonOption
from rig.terminal.result import CommandResult, missing_parts, removed_on_failure, running
from rig.terminal.text import command_line, counted

Layout = Literal["photos", "nerfstudio", "colmap", "hdr-nerf", "rawnerf", "llff"]
Identity = Literal["serial", "folder", "one"]
Together = Literal["time", "order", "never"]


def import_(
    photos: Annotated[
        Path,
        typer.Argument(
            metavar="PHOTOS",
            help="Folder of RAW, JPEG, HEIC, WebP, PNG, TIFF, EXR or HDR files; or scene of nerfstudio, "
            "COLMAP, LLFF, HDR-NeRF or RawNeRF; or a video.",
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The session folder to make.")],
    layout: Annotated[
        Layout | None, typer.Option(help="Layout of the folder; recognised by its files if not given.")
    ] = None,
    cameras: Annotated[
        Identity | None, typer.Option(help="What tells cameras apart; guessed if not given.")
    ] = None,
    bracket: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Exposures in each bracket; guessed if not given.")
    ] = None,
    together: Annotated[
        Together | None,
        typer.Option(help="How brackets of several cameras are matched to a frame; guessed if not given."),
    ] = None,
    exposures: Annotated[
        Path | None,
        typer.Option(help="A list 'file, seconds, f-number, ISO', an .hdrgen or image_list.txt."),
    ] = None,
    masks: Annotated[
        Path | None,
        typer.Option(help="A folder of PNG masks named as the photos, black where they are to be ignored."),
    ] = None,
    depths: Annotated[
        Path | None,
        typer.Option(
            help="A folder of depth maps named as the photos: 16-bit PNG in millimetres, EXR or NPY in units "
            "of the poses."
        ),
    ] = None,
    bands: Annotated[
        Path | None,
        typer.Option(
            help="A list of the filters before mono cameras, one line 'name, wavelength, bandwidth' (in nm) "
            "for each; photos of a filter have its name in theirs, or are in a folder of that name."
        ),
    ] = None,
    pixel_shift: Annotated[
        bool,
        typer.Option(
            "--pixel-shift",
            help="Combine every four RAW photographs of a camera, between which its sensor moved.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> CommandResult:
    """Make a session of photographs.

    Copies the photographs and sorts them into cameras, frames and brackets by their metadata;
    every guess is listed. Lenses, poses and scene points of a nerfstudio, COLMAP, LLFF, HDR-NeRF
    or RawNeRF folder are kept, so that it can be reconstructed without rig calibrate.

    Example: rig import photos/ S
    """
    with running("import") as status, removed_on_failure(out, unless=has_shots):
        from capture.imports.photos import import_photos

        result = import_photos(
            photos,
            out,
            layout=layout,
            cameras=cameras,
            bracket=bracket,
            together=together,
            exposures=exposures,
            masks=masks,
            depths=depths,
            bands=bands,
            pixel_shift=pixel_shift,
            on_progress=status,
        )
        if result.views:
            from rig.report.pages.calibration import calibration_report

            calibration_report(out, on_progress=status)
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
