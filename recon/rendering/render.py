"""Pictures of a scene on disk: linear EXR, and PNG as a display would show it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from os import PathLike
from pathlib import Path

import numpy as np

from imaging.arguments import checked
from imaging.arrays import Array
from imaging.choices import Space
from imaging.errors import InputError, ReconstructionError
from imaging.files import store
from imaging.files.photo import encode_png
from imaging.progress import Progress, unreported
from imaging.session.paths import find_reconstruction
from recon.rendering.cameras.camera_files import read_camera_path
from recon.rendering.cameras.camera_paths import CameraPath, named_path
from recon.rendering.earlier_frames import earlier_frames
from recon.rendering.frame_files import Films, Frame, Pictures
from recon.rendering.light_files import header_of, stem, write_light
from recon.rendering.light_probe import light_probe
from recon.rendering.request import RenderRequest
from recon.rendering.simulated_raw import RawCamera, require_raw
from recon.result.data_layers import DataLayers
from recon.result.display import displayed, in_colour, picture
from recon.result.environment_files import LAYOUT
from recon.result.layer_names import LAYERS
from recon.result.scene import Scene, open_scene
from recon.splat import SplatCamera

PROBE_WIDTH = 1024
"""Pixels, of a light probe."""
FIRST_FRAME = 1001
"""First frame number of a path, as in film."""
_DEFAULTS = RenderRequest()


@checked
def render(
    folder: str | PathLike[str],
    out: str | PathLike[str],
    request: RenderRequest = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    on_message: Callable[[str], None] = lambda line: None,
    **options: object,
) -> list[Path]:
    """Render views of a reconstruction, or a path through it.

    Each picture is an EXR of linear radiance times the exposure of the session (of a scene of bands a
    spectral EXR, a channel each, and PNG in false colours), and one sRGB PNG for each of `stops`; with `hdr`
    the first of these also for HDR screens (`imaging/files/hdr_display.py`), and of a film two more. Where
    the photographs had alpha, the EXR has it as A with the light premultiplied, the PNG as straight alpha,
    and pictures for HDR screens are over black.

    Args:
        folder: Reconstruction, or a session for its newest.
        out: Folder of the pictures.
        request: Options.
        on_progress: Callback for the current step, the steps done, and all of them.
        on_message: Callback for lines on the cameras of a file, on frames that see nothing of the scene, and
            on files of another render of the path.
        options: Options by name, in place of those of `request`.

    Returns:
        The files, EXR first.

    Raises:
        ReconstructionError: The scene has no such view, or, after all is written, no frame sees any Gaussian.
        InputError: The path is invalid, the camera unknown, or a film wanted without stops.
        StorageError: The disk refuses.
    """
    out = Path(out)
    for layer in request.layers:
        if layer not in LAYERS:
            raise InputError(f"There is no layer {layer!r:.60}: choose from {', '.join(LAYERS)}.")
    if request.video and not request.stops:
        raise InputError("A film is made of the PNG files, which need stops: name one, such as 0.")
    # The disk is tried before a scene is opened and drawn, which takes longer.
    store.require_writable(out)
    if request.raw is not None and not isinstance(folder, Scene):
        require_raw(find_reconstruction(Path(folder)), request.raw)
    scene = open_scene(folder)
    _check_space(scene, request.space)
    path = _path(scene, request, on_message)
    frames = list(_frames(scene, request, path))
    sensor = None if request.raw is None else RawCamera.of(scene, request.raw)
    store.make_folder(out)
    # Films are written while frames are drawn: a path has more of them than memory holds.
    with ExitStack() as stack:
        films = Films(stack, out / (path.name if path else "views"), request) if request.video else None
        pictures = Pictures(scene, out, request, DataLayers(scene, on_progress), sensor, films)
        for done, frame in enumerate(frames):
            on_progress("rendering", done, len(frames))
            pictures.draw(frame, seed=done)
    on_progress("rendering", len(frames), len(frames))
    _tell_empty(scene, pictures.empty, len(frames), path is not None, on_message)
    written = pictures.written()
    if path is not None and (others := earlier_frames(out, path.name, written)):
        on_message(
            f"{out} also holds {others[0]}{f' and {len(others) - 1} more files' if others[1:] else ''} "
            f"of another render of {path.name}: programs read them as one shot, move away what is not of it"
        )
    return written


def _tell_empty(
    scene: Scene, empty: Sequence[str], frames: int, moving: bool, say: Callable[[str], None]
) -> None:
    """Report the frames that see nothing of a scene; ReconstructionError if all do."""
    if not empty:
        return
    if len(empty) < frames:
        say(f"{len(empty)} of {frames} frames do not see the scene, the first is {empty[0]}")
        return
    fix = (
        "a path has to be in the coordinates of the calibration, or name by --path-in the file of rig export "
        "that it was made in"
        if moving
        else "its Gaussians are not before its views, so reconstruct it again"
    )
    raise ReconstructionError(f"No frame sees anything of {scene.folder} (alpha is 0 everywhere): {fix}.")


@checked
def render_probe(
    folder: str | PathLike[str],
    out: str | PathLike[str],
    place: Sequence[float] | str,
    request: RenderRequest = _DEFAULTS,
    **options: object,
) -> list[Path]:
    """Render all light that arrives at a place, a map of latitude and longitude: probe.exr and probe.png in
    `out`.

    The layout of the map, in its header, is that of the scene's environment.exr.

    Args:
        folder: Reconstruction, or a session for its newest.
        out: Folder of the two files.
        place: Coordinates x, y, z in the world of the calibration, or the name of a view, whose camera's
            centre it is.
        request: Options as of `render`, of which width (of the map, half as high), exposure, space, exr and
            shown count.
        options: Options by name, in place of those of `request`.

    Returns:
        The files, EXR first.

    Raises:
        InputError: The place is invalid, or other primaries are wanted of a scene of bands.
        ReconstructionError: There is no such reconstruction or view.
        StorageError: The disk refuses.
    """
    out = Path(out)
    store.require_writable(out)
    scene = open_scene(folder)
    _check_space(scene, request.space)
    centre = _place(scene, place)
    probe = light_probe(scene, centre, max(1, (request.width or PROBE_WIDTH) // 2))
    side, up, middle = (" ".join(f"{part:.9g}" for part in axis) for axis in probe.axes)
    factor = scene.exposure if request.exposure is None else 2.0**request.exposure
    header = header_of(scene.record, "probe", factor) | {
        "rig:known": probe.known,
        "rig:place": " ".join(f"{part:.9g}" for part in centre),
        "rig:layout": LAYOUT,
        "rig:up": up,
        "rig:middle": middle,
        "rig:longitude90": side,
    }
    store.make_folder(out)
    files = [out / "probe.exr", out / "probe.png"]
    values = probe.light * np.float32(factor)
    bands = scene.record.bands
    write_light(files[0], values, header, bands, request.space, probe.alpha, storage=request.exr)
    shot = picture(in_colour(probe.light, bands), probe.alpha, factor, request.shown or displayed)
    store.write_bytes(files[1], encode_png(shot))
    return files


def _place(scene: Scene, place: Sequence[float] | str) -> Array:
    if isinstance(place, str):
        motion = scene.view(place).cam_from_world.matrix()
        return np.asarray(-motion[:3, :3].T @ motion[:3, 3])
    centre = np.asarray(place, np.float64)
    if centre.shape != (3,) or not np.isfinite(centre).all():
        raise InputError(f"A probe needs three finite coordinates, not {place!r:.60}: name x, y, z.")
    return centre


def _check_space(scene: Scene, space: Space) -> None:
    """InputError for primaries of light that has none."""
    if scene.record.bands and space != "rec709":
        raise InputError(f"{scene.folder} has the light of bands, which has no primaries: leave --space out.")


def _path(scene: Scene, request: RenderRequest, say: Callable[[str], None]) -> CameraPath | None:
    """The cameras that are asked for in place of the views."""
    if request.path is None:
        if request.path_in is not None or request.path_camera is not None:
            raise InputError("--path-in and --path-camera need a path: name one with --path.")
        return None
    if request.views is not None:
        raise InputError("views and a path cannot be rendered at once: give only one of them.")
    if isinstance(request.path, CameraPath):
        return request.path
    cameras = camera_path(scene, request.path, within=request.path_in, camera=request.path_camera)
    if cameras.note:
        say(cameras.note)
    return cameras


def _frames(scene: Scene, request: RenderRequest, path: CameraPath | None) -> Iterator[Frame]:
    first, width, views = request.first_frame, request.width, request.views
    if path is None:
        for view in scene.views if views is None else tuple(scene.view(name) for name in views):
            yield Frame(stem(view), view.name, _resized(view.splat_camera, width))
        return
    start = first if first is not None else FIRST_FRAME
    for index, camera in enumerate(path.cameras):
        number = start + index if first is not None or not path.numbers else path.numbers[index]
        yield Frame(f"{path.name}.{number:04d}", f"{path.name} {number}", _resized(camera, width), number)


def camera_path(
    scene: Scene,
    path: str | PathLike[str],
    *,
    within: str | PathLike[str] | None = None,
    camera: str | None = None,
) -> CameraPath:
    """Resolve the path of `render` by its name, `orbit`, `spline:240` or a file.

    Args:
        scene: Scene that the path leads through.
        path: Name of the path, or its file (`read_camera_path`).
        within: File of `rig export` that defines the coordinates of a file without its own; None: those of
            the calibration.
        camera: Name of a camera of a stage of USD.

    Returns:
        The cameras in the world of the calibration.

    Raises:
        InputError: The path is invalid.
    """
    frames = named_path(scene, str(path))
    if frames is None:
        return read_camera_path(
            Path(path), scene, within=None if within is None else Path(within), camera=camera
        )
    if within is not None or camera is not None:
        raise InputError(f"{path} is not a file of cameras: leave --path-in and --path-camera out.")
    return frames


def _resized(camera: SplatCamera, width: int | None) -> SplatCamera:
    return camera if width is None else camera.resized(width)
