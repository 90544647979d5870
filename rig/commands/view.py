"""`rig view`: a scene in the browser."""

import os
import threading
import webbrowser
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Annotated

import typer

from imaging.and_list import and_list
from imaging.session.lock import is_held
from imaging.session.paths import find_reconstruction, session_of, without_scene
from rig.options.common import JsonOption, WrongUsage
from rig.terminal.failures import Stopped
from rig.terminal.result import CommandResult, running
from rig.view.pages import follow, opening, session_page
from rig.view.serving import first as first_picture
from rig.view.serving import server


def view(
    reconstructions: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECON...",
            help="SESSION/reconstructions/NAME, or a session for its newest scene, or for its photographs if "
            "it has none; two scenes are compared.",
        ),
    ],
    port: Annotated[
        int,
        typer.Option(
            metavar="PORT", min=1, max=65535, help="Port of the server; the next free one if it is taken."
        ),
    ] = 8080,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address of the server; 0.0.0.0 lets other machines connect, with the token in the printed "
            "URL.",
        ),
    ] = "127.0.0.1",
    as_json: JsonOption = False,
) -> CommandResult:
    """View a scene in the browser.

    Move with the mouse and set any exposure in stops. Choose ACES 2.0, AgX or a filmic curve, false colours
    by stops, or a map of clipped pixels. Click to measure light; go to the viewpoint of a photograph to
    compare. A scene that `rig reconstruct` is training is shown as it progresses. A session without a scene
    shows its photographs, and the rig once it is calibrated. Pictures are rendered in float and served to
    this machine only, until Ctrl-C.

    Example: rig view S
    """
    if len(reconstructions) > 2:
        raise WrongUsage("Two scenes can be compared, not more")
    with ExitStack() as stack:
        with running("view"):
            session = _followed(reconstructions[0]) if len(reconstructions) == 1 else None
            folders = [session] if session else [find_reconstruction(path) for path in reconstructions]
            label = " | ".join(folder.resolve().name for folder in folders)
            first = None if session else first_picture.FirstPicture.of(folders[0])
            viewer = stack.enter_context(server.Viewer(label, port, host, first))
        stack.enter_context(suppress(KeyboardInterrupt, Stopped))  # Ctrl-C ends it well, also while it opens
        _announce(folders, viewer.url)
        with running("view") as status:
            if session is not None:
                session_page.show_session(viewer, session)
                named = reconstructions[0]
                name = None if session == named else follow.name_of(named.resolve())
                wait: Callable[[], object] = follow.Follower(viewer, session, name).run
            else:
                status("opening the scene", 0, 0)

                opening.show_scenes(viewer, folders, status.say)
                wait = threading.Event().wait
        wait()
    return CommandResult({"shown": [str(folder) for folder in folders], "url": viewer.url})


def _followed(path: Path) -> Path | None:
    """Session whose training is followed: one that is under way, or that may begin; None for a finished
    scene.
    """
    around = session_of(path) if is_held(path) else None
    under_way = any(map(is_held, path.glob("reconstructions/*/")))
    return around or (path if under_way or without_scene(path) else None)


def _announce(folders: list[Path], url: str) -> None:
    typer.echo(f"{and_list(map(str, folders))}: {url} until Ctrl-C", err=True)
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)
