"""`rig view`: a scene in the browser."""

import os
import threading
import webbrowser
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Annotated

import typer

from imaging.session.paths import find_reconstruction
from rig.options.common import JsonOption
from rig.terminal.result import CommandResult, running


def view(
    reconstruction: Annotated[
        Path,
        typer.Argument(
            metavar="RECON", help="SESSION/reconstructions/NAME, or a session, whose newest is taken."
        ),
    ],
    port: Annotated[
        int,
        typer.Option(metavar="PORT", min=1, max=65535, help="Where to serve; the next free one if taken."),
    ] = 8080,
    as_json: JsonOption = False,
) -> CommandResult:
    """Look at a scene in the browser.

    Move through it with the mouse, at any exposure in stops; see it in ACES 2.0, in false colours by stops or
    with what clips; measure light by a click; stand where a photograph was taken and compare. It is drawn
    here in float and served to this machine alone, until Ctrl-C.

    Example: rig view S
    """
    with ExitStack() as stack:
        with running("view") as status:
            from recon.result.scene import open_scene
            from rig.view.server import Viewer

            folder = find_reconstruction(reconstruction)
            status("opening the scene", 0, 0)
            viewer = stack.enter_context(Viewer(open_scene(folder), port))
        with suppress(KeyboardInterrupt):
            typer.echo(f"{folder} is at {viewer.url} until Ctrl-C", err=True)
            if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
                webbrowser.open(viewer.url)
            threading.Event().wait()
    return CommandResult({"reconstruction": str(folder), "url": viewer.url})
