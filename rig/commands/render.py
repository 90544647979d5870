"""`rig render`: pictures of scenes in linear light."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from imaging.and_list import and_list
from imaging.errors import InputError
from imaging.files import hdr_display
from imaging.files.exr import reading
from imaging.session.paths import find_reconstruction, scene_around
from recon.rendering import render as rendering
from recon.rendering import simulated_raw
from recon.rendering.request import RenderRequest
from recon.result import display
from recon.result import scene as opening
from recon.result.layer_names import LAYERS, Layer
from rig.options.common import JsonOption, ReconstructionsArgument
from rig.options.defaults import is_typed, is_users, without_users
from rig.options.request import Asked, Shown
from rig.terminal.result import CommandResult, for_each_scene, removed_on_failure, running
from rig.terminal.text import counted, number
from rig.view.pictures import look

_CAMERAS, _FILES, _PICTURES = "Which cameras", "EXR files", "PNG files and film"


def _layers(text: str) -> tuple[Layer, ...]:
    """The layers of data that are named; InputError for another."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in LAYERS:
            raise InputError(f"There is no layer {name!r}: choose from {', '.join(LAYERS)}.")
    return tuple(layer for layer in LAYERS if layer in names)


NO_OPTIONS = RenderRequest()
OPTIONS = Asked(
    beside=("views", "stops", "shown"),
    path=Shown(kind=str | None, how={"metavar": "PATH", "rich_help_panel": _CAMERAS}),
    path_in=Shown(how={"metavar": "FILE", "rich_help_panel": _CAMERAS}),
    path_camera=Shown(how={"metavar": "NAME", "rich_help_panel": _CAMERAS}),
    first_frame=Shown(
        "--start-frame", how={"metavar": "N", "min": 0, "max": 10_000_000, "rich_help_panel": _CAMERAS}
    ),
    width=Shown(how={"metavar": "PX", "min": 16, "max": 16384, "rich_help_panel": _CAMERAS}),
    space=Shown(how={"rich_help_panel": _FILES}),
    exr=Shown(how={"rich_help_panel": _FILES}),
    layers=Shown(
        kind=str | None,
        made=_layers,
        more="Commas between.",
        how={"metavar": "NAMES", "rich_help_panel": _FILES},
    ),
    raw=Shown(how={"metavar": "CAMERA", "rich_help_panel": _FILES}),
    exposure=Shown(how={"metavar": "STOPS", "min": -60, "max": 60, "rich_help_panel": _PICTURES}),
    hdr=Shown(how={"rich_help_panel": _PICTURES}),
    video=Shown(how={"rich_help_panel": _PICTURES}),
    rate=Shown("--fps", how={"metavar": "HZ", "min": 1, "max": 240, "rich_help_panel": _PICTURES}),
)


def render(
    context: typer.Context,
    reconstructions: ReconstructionsArgument,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Output folder; each scene gets a subfolder.")
    ] = Path("renders"),
    request: Annotated[RenderRequest, OPTIONS] = NO_OPTIONS,
    probe: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Write the light arriving at this point from all directions instead, as a "
            "latitude-longitude map (probe.exr) for lighting; in coordinates of the calibration.",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    probe_view: Annotated[
        str | None,
        typer.Option(
            metavar="FRAME/CAMERA",
            help="The same, at the camera position of a view.",
            rich_help_panel=_CAMERAS,
        ),
    ] = None,
    tones: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Tone curve of rig view, such as linear, aces-2.0, agx, filmic or false-colour.",
            rich_help_panel=_PICTURES,
        ),
    ] = "linear",
    as_json: JsonOption = False,
) -> CommandResult:
    """Render scenes to EXR and PNG files.

    Renders every view of the scene, or a moving camera, into FOLDER/NAME: EXR in linear light of Rec.709,
    ACEScg or ACES2065-1, and PNG encoded for display; --hdr adds pictures for HDR screens. Needs only the
    scene's folder, not its session. Files of a path are named NAME.1001.exr and so on. docs/render.md has the
    details.

    Example: rig render S --path spline:240 --layers depth,normal
    """
    with running("render") as status:
        folders = _scenes(reconstructions)
        targets = _targets(folders, out)
        request, probe, probe_view = _agreeing(context, request, probe, probe_view)
        if request.first_frame is not None and request.path is None:
            raise InputError("--start-frame numbers the frames of a path: name one by --path.")
        place = _place(probe, probe_view)
        if place is not None and any((request.path, request.layers, request.video, request.raw, request.hdr)):
            raise InputError(
                "A light probe is one picture: leave --path, --layers, --video, --raw and --hdr out."
            )
        asked = replace(request, shown=_tones(tones))

        def render_one(folder: Path) -> CommandResult:
            target = targets[folder]
            with removed_on_failure(target, unless=lambda path: any(path.rglob("*.exr"))):
                if asked.raw is not None:
                    simulated_raw.require_raw(folder, asked.raw)  # opening a scene takes longer
                scene = opening.open_scene(folder)
                scale = scene.exposure if asked.exposure is None else 2.0**asked.exposure
                if place is not None:
                    status("drawing the light probe", 0, 0)
                    files = rendering.render_probe(scene, target, place, asked)
                    return CommandResult(
                        _scene_data(folder, target, files, scale),
                        [
                            f"{files[0]}: the light that arrives at {probe or probe_view} of {folder}",
                            *_unknown(reading.read_exr_header(files[0]).attributes),
                        ],
                    )
                said: list[str] = []
                files = rendering.render(scene, target, asked, on_progress=status, on_message=said.append)
            usual = ", the exposure of the session" if asked.exposure is None else ""
            kind = "frame" if asked.path else "view"
            count = sum(file.suffix == ".exr" for file in files)
            films = [file for file in files if file.suffix == ".mp4"]
            return CommandResult(
                _scene_data(folder, target, files, scale),
                [
                    f"{target}: {counted(count, kind)} of {folder}, as EXR"
                    f"{', PNG, Ultra HDR JPEG and AVIF' if asked.hdr else ' and PNG'}"
                    f"{', and ' + and_list(file.name for file in films) if films else ''}",
                    f"EXR values are light times {number(scale)} ({math.log2(scale):+.1f} stops){usual}",
                    *([_hdr(film=asked.video)] if asked.hdr else []),
                    *said,
                ],
            )

        result = for_each_scene(folders, render_one, "rendered")
    result.data["space"] = request.space
    return result


def _agreeing(
    context: typer.Context, request: RenderRequest, probe: str | None, view: str | None
) -> tuple[RenderRequest, str | None, str | None]:
    """The request and the place of a probe, without defaults of the user's that contradict what was typed."""
    pictures = any(is_typed(context, name) for name in ("path", "layers", "video", "raw", "hdr"))
    if is_users(context, "probe") and (pictures or view is not None):
        probe = None
    if is_users(context, "probe_view") and (pictures or probe is not None):
        view = None
    if probe is not None or view is not None:
        request = without_users(context, request, "path", "layers", "raw")
    if request.path is None:
        request = without_users(context, request, "path_in", "path_camera", "first_frame")
    return request, probe, view


def _hdr(*, film: bool) -> str:
    """Headroom of pictures for HDR screens, in a sentence; film: there is one, in HLG too."""
    white, stops = hdr_display.WHITE, hdr_display.HEADROOM
    hlg = f", and in HLG at {hdr_display.HLG_BRIGHTEST:.0f} cd/m2" if film else ""
    return (
        f"on HDR screens an EXR value of 1 is {white:.0f} cd/m2; light is clipped {stops:.0f} stops above it"
        f"{hlg}"
    )


def _place(probe: str | None, view: str | None) -> str | tuple[float, ...] | None:
    """Place of a light probe; None if not requested. InputError for an invalid place."""
    if probe is None:
        return view
    if view is not None:
        raise InputError(
            "--probe and --probe-view both set the position of the probe: give only one of them."
        )
    try:
        numbers = tuple(float(part) for part in probe.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise InputError(
            f"--probe {probe!r} is not a position: write X,Y,Z, three numbers separated by commas."
        )
    return numbers


def _unknown(attributes: Mapping[str, object]) -> list[str]:
    """Gaps of a light probe, in a sentence."""
    known = attributes["rig:known"]
    if not isinstance(known, float) or known > 0.995:
        return []
    return [f"the scene has light from {100 * known:.0f} % of all directions; the rest of the map is black"]


def _tones(name: str) -> "display.Shown":
    """The map of tones of a name, as rig view has them; InputError for another."""
    names = {one.lower().replace(" ", "-"): one for one in look.TONE_MAPS}
    tone_map = names.get(name.lower().replace(" ", "-"))
    if tone_map is None:
        raise InputError(f"There are no tones {name!r}: choose one of {', '.join(names)}.")
    return look.Look(tones=tone_map).shown


def _scene_data(folder: Path, target: Path, files: Sequence[Path], scale: float) -> dict[str, Any]:
    return {
        "reconstruction": str(folder),
        "out": str(target),
        "exposure_factor": scale,
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
        if target.resolve() == folder.resolve():
            raise InputError(f"{target} is the file of the scene: name another folder with --out.")
        targets[folder] = target
    return targets
