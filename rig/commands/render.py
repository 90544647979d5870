"""`rig render`: pictures of a scene in linear light."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import JsonOption, ReconstructionArgument, SpaceOption
from rig.running import Outcome, leaving_nothing, running
from rig.sessions import find_reconstruction
from rig.words import counted


def render(
    reconstruction: ReconstructionArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The folder for the EXR files.")],
    space: SpaceOption = "rec709",
    as_json: JsonOption = False,
) -> Outcome:
    """Render a scene to EXR pictures.

    One for every view of the session, in linear light of Rec.709, ACEScg or ACES2065-1.

    Example: rig render S/reconstructions/nh-3dgs renders/
    """
    with running("render") as meter:
        folder = find_reconstruction(reconstruction)
        with leaving_nothing(out, unless=lambda path: any(path.rglob("*.exr"))):
            from recon.renders import render as render_scene

            files = render_scene(folder, out, space=space, progress=meter)
    lines = [f"{out}: {counted(len(files), 'render')}"]
    data = {"reconstruction": str(folder), "space": space, "files": [str(file) for file in files]}
    return Outcome(data, lines)
