"""`rig import`: make a session of photographs that exist."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import JsonOption
from rig.running import Outcome, leaving_nothing, running, shortfall
from rig.sessions import has_shots
from rig.words import counted


def import_(
    photos: Annotated[
        Path, typer.Argument(metavar="PHOTOS", help="A folder of RAW, JPEG, PNG, TIFF or EXR files.")
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The session folder to make.")],
    bracket: Annotated[
        int | None, typer.Option(min=1, help="Exposures in each bracket; guessed if not given.")
    ] = None,
    as_json: JsonOption = False,
) -> Outcome:
    """Make a session of photographs.

    They are copied, and sorted into cameras, frames and brackets by what their files say; what had
    to be guessed is told.

    Example: rig import photos/ S
    """
    with running("import") as meter, leaving_nothing(out, unless=has_shots):
        from capture.photos import import_photos

        result = import_photos(photos, out, bracket=bracket, progress=meter)
    lines = [
        f"{out}: {counted(result.shots, 'photo')} as {counted(result.frames, 'frame')} "
        f"of {counted(result.cameras, 'camera')}"
    ]
    lines += [f"  {guess}" for guess in result.guesses]
    lines.append(f"Next: rig calibrate {out}")
    data = {
        "session": str(out),
        "cameras": result.cameras,
        "frames": result.frames,
        "shots": result.shots,
        "guesses": list(result.guesses),
        "missing_photos": list(result.missing),
    }
    return Outcome(data, lines, shortfall(result.require_complete), usable=result.shots > 0)
