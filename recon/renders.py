"""Pictures of a scene on disk: linear EXR, and PNG as a display would show it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from imaging import store
from imaging.colour import SPACE_PRIMARIES, Space, space_from_rec709, srgb_encode
from imaging.exr import write_exr
from imaging.photo import encode_png
from recon.dataset import View
from recon.model import Opened, open_model
from recon.pixels import Progress

MIDDLE_GREY = 0.18


def render(
    folder: Path,
    out: Path,
    *,
    views: Sequence[str] | None = None,
    stops: Sequence[float] = (0.0,),
    space: Space = "rec709",
    progress: Progress | None = None,
) -> list[Path]:
    """Render views of a reconstruction into `out`; the files written, EXR first.

    views: names `frame/camera`; None: every view of the session. Of each view an EXR of linear
    radiance in the units of the calibration, its primaries those of `space`, and one PNG for each of
    `stops`: sRGB, exposed so that the median luminance over all these views is middle grey, plus so
    many stops.
    ReconstructionError for a view that the session does not have.
    """
    opened = open_model(folder)
    chosen = opened.dataset.views if views is None else tuple(opened.view(name) for name in views)
    from_rec709 = space_from_rec709(space).astype(np.float32)
    files, images = [], []
    store.make_folder(out)
    for done, view in enumerate(chosen):
        if progress:
            progress("rendering", done, len(chosen))
        image = radiance(opened, view)
        path = out / f"{stem(view)}.exr"
        write_exr(
            path,
            image @ from_rec709.T,
            chromaticities=SPACE_PRIMARIES[space],
            attributes={"rig:view": view.name},
        )
        files.append(path)
        images.append(image)
    grey = display_scale(images)
    for view, image in zip(chosen, images, strict=True):
        for step in stops:
            path = out / (f"{stem(view)}.png" if len(stops) == 1 else f"{stem(view)}_{step:+g}ev.png")
            store.write_bytes(path, encode_png(displayed(image, grey * 2.0**step)))
            files.append(path)
    if progress:
        progress("rendering", len(chosen), len(chosen))
    return files


def stem(view: View) -> str:
    """File name of a view without its suffix."""
    return f"{view.frame:04d}_{view.camera}"


def radiance(opened: Opened, view: View) -> npt.NDArray[np.float32]:
    """Linear Rec.709 radiance of a view, float32 [H, W, 3]."""
    image = opened.training.method.observation.radiance(opened.render(view.lens))
    return np.ascontiguousarray(image.numpy(), np.float32)


def display_scale(images: Sequence[npt.NDArray[Any]]) -> float:
    """The factor that brings the median of positive light to middle grey; 1 without any light."""
    lit = np.concatenate([image.reshape(-1) for image in images])
    lit = lit[lit > 0]
    return float(MIDDLE_GREY / np.median(lit)) if lit.size else 1.0


def displayed(image: npt.NDArray[Any], scale: float) -> npt.NDArray[np.uint8]:
    """Linear light times a scale, clipped, as sRGB of 8 bits."""
    return np.asarray(np.round(255 * srgb_encode(np.clip(image * scale, 0, 1))), np.uint8)
