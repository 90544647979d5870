"""`rig export`: a scene for other programs."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from imaging.session.paths import find_reconstruction
from recon.exports import export as exporting
from recon.exports import hand_over
from recon.exports import loss as losses
from recon.exports.request import ExportRequest
from rig.options.common import JsonOption, WrongUsage
from rig.options.defaults import is_users, without_users
from rig.options.request import Asked, Shown
from rig.terminal.result import CommandResult, running
from rig.terminal.text import counted, number, size

NO_OPTIONS = ExportRequest()
OPTIONS = Asked(
    linear=Shown(name="--linear/--display"),
    exposure=Shown(how={"metavar": "STOPS", "min": -60, "max": 60}),
    program=Shown(name="--for"),
)


def export(
    context: typer.Context,
    reconstruction: Annotated[
        Path,
        typer.Argument(metavar="RECON", help="SESSION/reconstructions/NAME, or a session for its newest."),
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The file to write; its extension selects the format.")
    ] = None,
    request: Annotated[ExportRequest, OPTIONS] = NO_OPTIONS,
    vfx: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Write the whole hand-over folder instead: USD, EXR renders that line up with its cameras, "
            "the cameras for other programs, an OpenColorIO configuration, and a page that explains how to "
            "open it.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> CommandResult:
    """Export a scene to other formats.

    The loss of light is measured on the scene and stated in stops, for its Gaussians and for pictures drawn
    from the file. --out scene.html is a page that shows the scene at any exposure, offline, in any browser of
    2023 or later. docs/export.md explains each format.

    Example: rig export S --out scene.usdc
    """
    if is_users(context, "out") and vfx is not None:
        out = None
    elif is_users(context, "vfx") and out is not None:
        vfx = None
    if vfx is not None:
        request = without_users(context, request, "format", "program")
    if (out is None) == (vfx is None):
        raise WrongUsage("Name a file with --out, or a folder with --vfx")
    given = (request.format, request.linear, request.program, request.albedo)
    if vfx is not None and given != (None, None, None, False):
        raise WrongUsage(
            "--vfx writes its own formats, in linear light: leave --format, --linear, --display, --for and "
            "--albedo out"
        )
    with running("export") as status:
        folder = find_reconstruction(reconstruction)
        status("opening the scene", 0, 0)
        if vfx is not None:
            return _handed_over(
                folder, hand_over.hand_over(folder, vfx, exposure=request.exposure, on_progress=status)
            )
        assert out is not None
        exported = exporting.export(folder, out, request, on_progress=status)
    written = sum(path.stat().st_size for path in exported.files)
    if exported.format == "cameras":
        lines = [
            f"{out}: the cameras of {counted(exported.views, 'view')} of {folder}, for COLMAP and nerfstudio"
        ]
        return CommandResult({"reconstruction": str(folder)} | exported.data(), lines)
    light = "linear light" if exported.linear else "sRGB as displays show it"
    if exported.brightest is not None and exported.brightest > 1:
        light = f"sRGB codes, of light up to {exported.brightest:.0f} times white"
    made = "" if exported.loss is not None else f"{exported.format} made of "
    what = f"{made}{counted(exported.gaussians, 'Gaussian')} of {folder}, {light}"
    lines = [
        f"{exported.files[0]}: {what}, {size(written)}",
        *(f"beside it: {path}" for path in exported.files[1:]),
        *_lost(exported.exposure_factor, exported.loss, exported.notes),
        *(() if exported.albedo is None else (f"albedo: {exported.albedo}",)),
        *((f"for {request.program}: {exported.opening}",) if exported.opening else ()),
    ]
    return CommandResult({"reconstruction": str(folder)} | exported.data(), lines)


def _handed_over(folder: Path, done: "hand_over.HandOver") -> CommandResult:
    written = sum(path.stat().st_size for path in done.files)
    data = {
        "reconstruction": str(folder),
        "vfx": str(done.folder),
        "gaussians": done.gaussians,
        "exposure_factor": done.exposure_factor,
        "files": [str(path) for path in done.files],
        "bytes": written,
        "loss": done.loss.data(),
        "not_in_it": list(done.notes),
    }
    lines = [
        f"{done.folder}: {counted(done.gaussians, 'Gaussian')} of {folder} in "
        f"{counted(len(done.files), 'file')}, {size(written)}; begin with {done.folder / 'index.html'}",
        *_lost(done.exposure_factor, done.loss, done.notes),
    ]
    return CommandResult(data, lines)


def _lost(factor: float, loss: "losses.Loss | None", notes: Sequence[str]) -> list[str]:
    lines = [f"its light is that of the scene times {number(factor)} ({math.log2(factor):+.1f} stops)"]
    if loss is not None:
        lines.append(f"lost: {loss}")
    return [*lines, *(f"not in it: {note}" for note in notes)]
