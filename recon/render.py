"""Pictures of a scene on disk: linear EXR, and PNG as a display would show it."""

import math
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from imaging.colour import SPACE_PRIMARIES, Space, space_from_rec709
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr import white_luminance, write_exr
from imaging.files.photo import encode_png
from imaging.progress import Progress, unreported
from imaging.session.bands import LAYOUT, channels
from recon.result.display import in_colour, picture
from recon.result.model import ModelRecord
from recon.result.scene import open_scene


def render(
    folder: str | PathLike[str],
    out: str | PathLike[str],
    *,
    views: Sequence[str] | None = None,
    stops: Sequence[float] = (0.0,),
    exposure: float | None = None,
    space: Space = "rec709",
    width: int | None = None,
    on_progress: Progress = unreported,
) -> list[Path]:
    """Render views of a reconstruction into `out`; the files written, EXR first.

    views: names `frame/camera`; None: every view of the scene. Of each view an EXR of linear
    radiance in the units of the calibration, its primaries those of `space` (of a scene of bands a spectral
    EXR, a channel each, and PNG in false colours), and one PNG for each of
    `stops`: sRGB of the radiance times 2^(exposure + stops), clipped. Where the photographs had alpha, the
    EXR has it as A with the light premultiplied, the PNG as straight alpha. exposure: None takes what shows
    the median of the scene as middle grey; the EXR name that factor as `rig:exposure`. width: of the
    pictures, px; None: as the views were trained.
    ReconstructionError for a view that the scene does not have.
    """
    out = Path(out)
    store.require_writable(out)
    scene = open_scene(folder)
    bands = scene.record.bands
    if bands and space != "rec709":
        raise InputError(f"{folder} has the light of bands, which has no primaries: leave --space out.")
    chosen = scene.views if views is None else tuple(scene.view(name) for name in views)
    shown = math.log2(scene.exposure) if exposure is None else exposure
    files, pictures = [], []
    store.make_folder(out)
    for done, view in enumerate(chosen):
        on_progress("rendering", done, len(chosen))
        camera = view.splat_camera if width is None else view.splat_camera.resized(width)
        image, alpha = scene.layer(camera)
        path = out / f"{stem(view)}.exr"
        write_light(path, image, scene.record, view, space, alpha)
        files.append(path)
        for step in stops:
            path = out / (f"{stem(view)}.png" if len(stops) == 1 else f"{stem(view)}_{step:+g}ev.png")
            shown_light = in_colour(image, bands)
            store.write_bytes(path, encode_png(picture(shown_light, alpha, 2.0 ** (shown + step))))
            pictures.append(path)
    on_progress("rendering", len(chosen), len(chosen))
    return files + pictures


def write_light(
    path: Path,
    light: npt.NDArray[np.float32],
    record: ModelRecord,
    view: "Named",
    space: Space = "rec709",
    alpha: npt.NDArray[np.float32] | None = None,
) -> None:
    """Write light [H, W, C] of a scene as EXR: of bands a channel each, else in the primaries of a space.

    alpha [H, W]: written as channel A, by which the light is premultiplied already.
    """
    header, primaries = attributes(record, view), None
    if record.bands:
        header |= LAYOUT
    else:
        light, primaries = light @ space_from_rec709(space).astype(np.float32).T, SPACE_PRIMARIES[space]
    planes = {name: light[..., index] for index, name in enumerate(channels(record.bands))}
    if alpha is not None:
        planes["A"] = alpha
    write_exr(path, planes, chromaticities=primaries, attributes=header)


class Named(Protocol):
    """A camera at a frame."""

    @property
    def camera(self) -> str:
        """The camera's name."""
        ...

    @property
    def frame(self) -> int:
        """The number of the frame."""
        ...

    @property
    def name(self) -> str:
        """`frame/camera`."""
        ...


def stem(view: Named) -> str:
    """File name of a view without its suffix."""
    return f"{view.frame:04d}_{view.camera}"


def attributes(record: ModelRecord, view: Named) -> dict[str, str | float]:
    """What the header of an EXR says of its values."""
    absolute = {} if record.luminance is None else white_luminance(*record.luminance)
    return {
        **absolute,
        "rig:view": view.name,
        "rig:values": f"linear radiance {record.radiance}",
        "rig:exposure": record.exposure,
        "rig:exposureNote": "values times rig:exposure show the median of the scene as middle grey, 0.18",
    }
