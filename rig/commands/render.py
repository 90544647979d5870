"""`rig render`: pictures of scenes in linear light."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from imaging.errors import InputError
from imaging.session.paths import find_reconstruction, scene_around
from rig.options.common import JsonOption, ReconstructionsArgument
from rig.terminal.result import CommandResult, for_each_scene, removed_on_failure, running
from rig.terminal.text import counted, number

if TYPE_CHECKING:
    from recon.rendering.data_layers import Layer
    from recon.result.display import Shown


_CAMERAS, _FILES, _PICTURES = "Which cameras", "EXR files", "PNG files and film"


def render(
    reconstructions: ReconstructionsArgument,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where to write, one folder for each scene.")
    ] = Path("renders"),
    path: Annotated[
        str | None,
        typer.Option(
            metavar="PATH",
            help="Draw a camera that moves instead of the views: orbit or spline (with a number of frames, "
            "spline:240), or a file of cameras: transforms.json, a folder with a COLMAP model, CSV, USD.",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    path_in: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The file of rig export (USD, glb, PLY) in whose coordinates the path is, where the path "
            "does not tell them, as CSV of Blender or Nuke. [default: those of the calibration]",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    path_camera: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Which camera of a USD stage. [default: the first that rig export did not write, if any]",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    start_frame: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            max=10_000_000,
            help="Number of the first frame of a path. [default: as its file says, else 1001]",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    probe: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Write the light that arrives there from all sides instead, a map of latitude and longitude "
            "(probe.exr) to light things with; in coordinates of the calibration.",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    probe_view: Annotated[
        str | None,
        typer.Option(
            metavar="FRAME/CAMERA",
            help="The same, where the camera of a view stood.",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    width: Annotated[
        int | None,
        typer.Option(
            metavar="PX",
            min=16,
            max=16384,
            help="Width of the pictures. [default: that of the training, or of the path; of a probe 1024]",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    space: Annotated[
        Literal["rec709", "acescg", "aces2065-1"],
        typer.Option(
            help="Primaries of the EXR files, which name them by colorInteropID; light is linear in all.",
            rich_help_panel=_FILES,
        ),
    ] = "rec709",
    layers: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help="Layers of data beside the light, in parts of their own: depth, alpha, normal, trust, "
            "with commas between. Trust is how many training views saw a surface and measured its light.",
            rich_help_panel=_FILES,
        ),
    ] = "",
    raw: Annotated[
        str | None,
        typer.Option(
            metavar="CAMERA",
            help="Write what the sensor of that camera would record too: RAW (DNG) by each exposure of its "
            "bracket, with its colours, filters and noise.",
            rich_help_panel=_FILES,
        ),
    ] = None,
    exposure: Annotated[
        float | None,
        typer.Option(
            metavar="STOPS",
            min=-60,
            max=60,
            help="The light times 2^STOPS. If it is not given, the median of each scene is middle grey.",
            rich_help_panel=_PICTURES,
        ),
    ] = None,
    tones: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Tones as in rig view, such as linear, aces-2.0, agx, filmic or false-colour.",
            rich_help_panel=_PICTURES,
        ),
    ] = "linear",
    video: Annotated[
        bool, typer.Option("--video", help="Write an MP4 of the PNG files too.", rich_help_panel=_PICTURES)
    ] = False,
    fps: Annotated[
        float,
        typer.Option(
            metavar="HZ", min=1, max=240, help="Frames a second of the MP4.", rich_help_panel=_PICTURES
        ),
    ] = 24.0,
    as_json: JsonOption = False,
) -> CommandResult:
    """Render scenes to EXR and PNG files.

    Every view of the scene, or a camera that moves through it, in linear light of Rec.709, ACEScg or
    ACES2065-1 (EXR), and as a display shows it (PNG), into FOLDER/NAME. Needs only the scene's folder, not
    its session. Files of a path are called NAME.1001.exr and so on. docs/render.md has more.

    Example: rig render S --path spline:240 --layers depth,normal
    """
    with running("render") as status:
        folders = _scenes(reconstructions)
        targets = _targets(folders, out)
        wanted = _layers(layers)
        if start_frame is not None and path is None:
            raise InputError("--start-frame numbers the frames of a path: name one by --path.")
        if (path_in is not None or path_camera is not None) and path is None:
            raise InputError("--path-in and --path-camera are of a path: name one by --path.")
        place = _place(probe, probe_view)
        if place is not None and (path or wanted or video or raw):
            raise InputError("A light probe is one picture: leave --path, --layers, --video and --raw out.")

        def render_one(folder: Path) -> CommandResult:
            target = targets[folder]
            with removed_on_failure(target, unless=lambda path: any(path.rglob("*.exr"))):
                from imaging.files.exr import read_exr_header
                from recon.rendering.render import PROBE_WIDTH, camera_path, render_probe
                from recon.rendering.render import render as render_scene
                from recon.result.scene import open_scene

                scene = open_scene(folder)
                if place is not None:
                    status("drawing the light probe", 0, 0)
                    files = render_probe(
                        scene,
                        target,
                        place,
                        width=width or PROBE_WIDTH,
                        exposure=exposure,
                        space=space,
                        shown=_shown(tones),
                    )
                    return CommandResult(
                        _scene_data(folder, target, files, scene.exposure),
                        [
                            f"{files[0]}: the light that arrives at {probe or probe_view} of {folder}",
                            *_unknown(read_exr_header(files[0]).attributes),
                        ],
                    )
                cameras = None
                if path is not None:
                    cameras = camera_path(scene, path, within=path_in, camera=path_camera)
                said = [cameras.note] if cameras is not None and cameras.note else []
                files = render_scene(
                    scene,
                    target,
                    path=cameras,
                    first_frame=start_frame,
                    space=space,
                    exposure=exposure,
                    width=width,
                    layers=wanted,
                    shown=_shown(tones),
                    video=video,
                    rate=fps,
                    raw=raw,
                    on_progress=status,
                    on_message=said.append,
                )
            scale = scene.exposure
            count = sum(file.suffix == ".exr" for file in files)
            return CommandResult(
                _scene_data(folder, target, files, scale),
                [
                    f"{target}: {counted(count, 'frame' if path else 'view')} of {folder}, as EXR and PNG"
                    f"{', and ' + files[-1].name if video else ''}",
                    f"EXR values times {number(scale)} ({math.log2(scale):+.1f} stops) show the median "
                    "of the scene as middle grey",
                    *said,
                ],
            )

        result = for_each_scene(folders, render_one, "rendered")
    result.data["space"] = space
    return result


def _place(probe: str | None, view: str | None) -> str | tuple[float, ...] | None:
    """Place of a light probe; None if not requested. InputError for an invalid place."""
    if probe is None:
        return view
    if view is not None:
        raise InputError("--probe and --probe-view both say where the probe stands: name one of them.")
    try:
        numbers = tuple(float(part) for part in probe.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise InputError(f"--probe {probe!r} is no place: write X,Y,Z, three numbers with commas between.")
    return numbers


def _unknown(attributes: Mapping[str, object]) -> list[str]:
    """Gaps of a light probe, in a sentence."""
    known = attributes["rig:known"]
    if not isinstance(known, float) or known > 0.995:
        return []
    return [f"the scene has light from {100 * known:.0f} % of all directions; the rest of the map is black"]


def _layers(text: str) -> "tuple[Layer, ...]":
    """The layers of data that are named; InputError for another."""
    from recon.rendering.data_layers import LAYERS

    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in LAYERS:
            raise InputError(f"There is no layer {name!r}: name any of {', '.join(LAYERS)}.")
    return tuple(layer for layer in LAYERS if layer in names)


def _shown(tones: str) -> "Shown":
    """The map of tones of a name, as rig view has them; InputError for another."""
    from rig.view.pictures.look import TONE_MAPS, Look

    names = {name.lower().replace(" ", "-"): name for name in TONE_MAPS}
    tone_map = names.get(tones.lower().replace(" ", "-"))
    if tone_map is None:
        raise InputError(f"There are no tones {tones!r}: name one of {', '.join(names)}.")
    return Look(tones=tone_map).shown


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
