"""Light of a scene as EXR, with layers of data in parts of their own."""

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from imaging.arrays import Array32
from imaging.colour import space_from_rec709
from imaging.files.exr import white_luminance, write_exr
from imaging.session.bands import LAYOUT, channels
from imaging.spaces import SPACE_PRIMARIES, Space
from recon.rendering.request import Layer
from recon.result.model import ModelRecord

CHANNELS: dict[Layer, tuple[str, ...]] = {
    "depth": ("Z",),
    "alpha": ("A",),
    "normal": ("N.X", "N.Y", "N.Z"),
    "trust": ("trust",),
}
NOTES: dict[Layer, str] = {
    "depth": "Z: along the camera's axis to where half of the light from behind is stopped, in units of the "
    "calibration; infinite where it never is",
    "alpha": "A: how much of the light comes from the scene's Gaussians",
    "normal": "N: unit vectors in axes of the world, towards the camera; zeros where there is no surface",
    "trust": "trust: views of the training that saw the surface and measured its light",
}


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


def stem(view: Named) -> str:
    """File name of a view without its suffix."""
    return f"{view.frame:04d}_{view.camera}"


def write_light(
    path: Path,
    light: Array32,
    record: ModelRecord,
    name: str,
    space: Space = "rec709",
    alpha: Array32 | None = None,
    layers: Mapping[Layer, Array32] | None = None,
    attributes: Mapping[str, str | float] | None = None,
) -> None:
    """Write light [H, W, C] of a scene as EXR: of bands a channel each, else in the primaries of a space.

    name: of what is seen, for the header. alpha [H, W]: written as channel A, by which the light is
    premultiplied already. layers: data [H, W], or [H, W, 3], each in a part of its name. attributes: more of
    the header.
    """
    header, primaries = _header(record, name) | dict(attributes or {}), None
    if record.bands:
        header |= LAYOUT
    else:
        light, primaries = light @ space_from_rec709(space).astype(np.float32).T, SPACE_PRIMARIES[space]
    planes = {channel: light[..., index] for index, channel in enumerate(channels(record.bands))}
    if alpha is not None:
        planes["A"] = alpha
    data: dict[str, dict[str, Array32]] = {}
    for layer, values in (layers or {}).items():
        split = np.moveaxis(np.atleast_3d(values), -1, 0)
        data[layer] = dict(zip(CHANNELS[layer], split, strict=True))
        header[f"rig:{layer}"] = NOTES[layer]
    write_exr(path, planes, primaries=primaries, attributes=header, data=data)


def _header(record: ModelRecord, name: str) -> dict[str, str | float]:
    """Return what the header of an EXR says of its values."""
    absolute = {} if record.luminance is None else white_luminance(*record.luminance)
    return {
        **absolute,
        "rig:view": name,
        "rig:values": f"linear radiance {record.radiance}",
        "rig:exposure": record.exposure,
        "rig:exposureNote": "values times rig:exposure show the median of the scene as middle grey, 0.18",
    }
