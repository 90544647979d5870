"""Pictures of a scene on disk: linear EXR, and PNG as a display would show it."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from imaging.colour import SPACE_PRIMARIES, Space, space_from_rec709
from imaging.files import store
from imaging.files.exr import white_luminance, write_exr
from imaging.files.photo import encode_png
from imaging.progress import Progress, unreported
from recon.result.display import displayed
from recon.result.model import ModelRecord
from recon.result.scene import open_scene


def render(
    folder: str | Path,
    out: str | Path,
    *,
    views: Sequence[str] | None = None,
    stops: Sequence[float] = (0.0,),
    exposure: float | None = None,
    space: Space = "rec709",
    progress: Progress = unreported,
) -> list[Path]:
    """Render views of a reconstruction into `out`; the files written, EXR first.

    views: names `frame/camera`; None: every view of the scene. Of each view an EXR of linear
    radiance in the units of the calibration, its primaries those of `space`, and one PNG for each of
    `stops`: sRGB of the radiance times 2^(exposure + stops), clipped. exposure: None takes what shows
    the median of the scene as middle grey; the EXR name that factor as `rig:exposure`.
    ReconstructionError for a view that the scene does not have.
    """
    out = Path(out)
    store.require_writable(out)
    scene = open_scene(folder)
    chosen = scene.views if views is None else tuple(scene.view(name) for name in views)
    from_rec709 = space_from_rec709(space).astype(np.float32)
    shown = math.log2(scene.exposure) if exposure is None else exposure
    files, pictures = [], []
    store.make_folder(out)
    for done, view in enumerate(chosen):
        progress("rendering", done, len(chosen))
        image = scene.radiance(view.splat_camera)
        path = out / f"{stem(view)}.exr"
        write_exr(
            path,
            image @ from_rec709.T,
            chromaticities=SPACE_PRIMARIES[space],
            attributes=attributes(scene.record, view),
        )
        files.append(path)
        for step in stops:
            path = out / (f"{stem(view)}.png" if len(stops) == 1 else f"{stem(view)}_{step:+g}ev.png")
            store.write_bytes(path, encode_png(displayed(image, 2.0 ** (shown + step))))
            pictures.append(path)
    progress("rendering", len(chosen), len(chosen))
    return files + pictures


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
