"""`rig normals`: normals and albedo from the lamps of a light dome."""

import re
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from calib.exports.normals import normals as estimates
from rig.options.common import JsonOption, SessionArgument
from rig.terminal.result import CommandResult, removed_on_failure, running
from rig.terminal.text import counted

EXAMPLE = "250,170,12,12=90%"
_PATCH = re.compile(r"\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*=\s*(\d+(?:\.\d*)?|\.\d+)\s*(%?)\s*")


class WhitePatch(NamedTuple):
    """Neutral patch; area: left, top, width and height, px; reflectance: 0..1."""

    area: tuple[int, int, int, int]
    reflectance: float


def white_patch(text: str) -> WhitePatch:
    """Parse for typer."""
    match = _PATCH.fullmatch(text)
    if match is None:
        raise typer.BadParameter(f"write a patch as {EXAMPLE}")
    left, top, width, height = (int(match[number]) for number in range(1, 5))
    reflectance = float(match[5]) / (100.0 if match[6] else 1.0)
    if not (width and height and 0.0 < reflectance <= 1.0):
        raise typer.BadParameter(f"a patch has pixels, and reflects 1 to 100 %, as in {EXAMPLE}")
    return WhitePatch((left, top, width, height), reflectance)


def normals(
    session: SessionArgument,
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="The EXR file; a preview as PNG goes beside it.")
    ],
    white: Annotated[
        WhitePatch | None,
        typer.Option(
            metavar="PATCH",
            parser=white_patch,
            help="A neutral patch of known reflectance, such as a grey card beside the things: "
            f"LEFT,TOP,WIDTH,HEIGHT=REFLECTANCE in pixels of the file, as in {EXAMPLE}. If it is not "
            "given, albedo is relative, with a median of 0.18.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> CommandResult:
    """Estimate normals and albedo from a light dome.

    A session of a light dome has a camera that stands still, a frame for each lamp, and lamps.json with the
    places of the lamps. OUT holds the albedo (R, G, B), normals (normal.X, .Y, .Z: right, up, towards the
    camera), their standard errors (sigma.R, .G, .B, and sigma.normal in degrees) and a mask. Shadows,
    highlights and saturated lamps are left out; with fewer than three lamps a pixel is unknown.

    Example: rig normals S normals.exr --white 250,170,12,12=90%
    """
    with running("normals") as status, removed_on_failure(out, unless=Path.is_file):
        area, reflectance = (None, 1.0) if white is None else white
        made = estimates.estimate_normals(
            session, out, white=area, reflectance=reflectance, on_progress=status
        )
    scale = "albedo by the patch" if made.absolute else "albedo relative: --white gives it its scale"
    lines = [
        f"{made.file}: {100 * made.known:.1f} % of the pixels have a normal, with a standard error of "
        f"{made.error:.2f}° in the median; {scale}",
        f"{counted(made.lamps, 'lamp')}, whose light the fit explains to {100 * made.misfit:.1f} %, noise "
        f"included; {100 * made.matt:.1f} % of what they light fits as a matt surface",
        f"{made.preview}: the normals, and the albedo beside them",
        *made.warnings,
    ]
    return CommandResult(asdict(made) | {"file": str(made.file), "preview": str(made.preview)}, lines)
