"""`rig render`: pictures of scenes in linear light."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from imaging.errors import InputError
from imaging.session.paths import find_reconstruction, scene_around
from rig.options.common import JsonOption, ReconstructionsArgument, SpaceOption
from rig.terminal.result import CommandResult, for_each_scene, removed_on_failure, running
from rig.terminal.text import counted, number


def render(
    reconstructions: ReconstructionsArgument,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where to write, one folder for each scene.")
    ] = Path("renders"),
    space: SpaceOption = "rec709",
    exposure: Annotated[
        float | None,
        typer.Option(
            metavar="STOPS",
            min=-60,
            max=60,
            help="Exposure of the PNG files: the light times 2^STOPS. If it is not given, the median of each "
            "scene is middle grey.",
        ),
    ] = None,
    width: Annotated[
        int | None,
        typer.Option(
            metavar="PX", min=16, max=16384, help="Width of the pictures. [default: that of the training]"
        ),
    ] = None,
    as_json: JsonOption = False,
) -> CommandResult:
    """Render scenes to EXR and PNG files.

    Every view of the scene in linear light of Rec.709, ACEScg or ACES2065-1 (EXR), and as a display shows it
    (PNG), into FOLDER/NAME. Needs only the scene's folder, not its session.

    Example: rig render S/reconstructions/* --out renders/
    """
    with running("render") as status:
        folders = _scenes(reconstructions)
        targets = _targets(folders, out)

        def render_one(folder: Path) -> CommandResult:
            target = targets[folder]
            with removed_on_failure(target, unless=lambda path: any(path.rglob("*.exr"))):
                from recon.render import render as render_scene
                from recon.result.model import read_model

                files = render_scene(
                    folder, target, space=space, exposure=exposure, width=width, on_progress=status
                )
            scale = read_model(folder).exposure
            return CommandResult(
                _scene_data(folder, target, files, scale),
                [
                    f"{target}: {counted(len(files) // 2, 'view')} of {folder}, as EXR and PNG",
                    f"EXR values times {number(scale)} ({math.log2(scale):+.1f} stops) show the median "
                    "of the scene as middle grey",
                ],
            )

        result = for_each_scene(folders, render_one, "rendered")
    result.data["space"] = space
    return result


def _scene_data(folder: Path, target: Path, files: Sequence[Path], scale: float) -> dict[str, Any]:
    return {
        "reconstruction": str(folder),
        "out": str(target),
        "exposure": scale,
        "files": [str(file) for file in files],
    }


def _scenes(paths: Sequence[Path]) -> list[Path]:
    """The scenes that were named, each once."""
    try:
        scenes = [find_reconstruction(path) for path in paths]
    except InputError as error:
        if len(paths) == 1:
            raise
        raise InputError(f"{str(error).rstrip('.')}; pictures go to the folder that --out names.") from error
    return list({folder.resolve(): folder for folder in scenes}.values())


def _targets(folders: Sequence[Path], out: Path) -> dict[Path, Path]:
    """The folder for the pictures of each scene; InputError if two would share one, or a scene would."""
    targets: dict[Path, Path] = {}
    for folder in folders:
        target = out / folder.resolve().name
        if target in targets.values():
            raise InputError(f"Two scenes are called {target.name}: render them with an --out each.")
        if scene := scene_around(target):
            raise InputError(f"{target} is in the folder of the scene {scene}: name another --out.")
        targets[folder] = target
    return targets
