"""Light of a scene as EXR, with layers of data in parts of their own."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

import numpy as np

from imaging.arrays import Array32
from imaging.choices import SPACE_PRIMARIES, ExrStorage, Space
from imaging.colour.spaces import space_from_rec709
from imaging.files.exr.camera import camera_attributes
from imaging.files.exr.writing import EXPOSURE_FACTOR, ExrValue, white_luminance, write_exr
from imaging.session.bands import LAYOUT, channels
from imaging.session.records import Band
from recon.result.layer_names import Layer
from recon.result.model import ModelRecord
from recon.splat import SplatCamera

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
    header: Mapping[str, ExrValue],
    bands: Sequence[Band] = (),
    space: Space = "rec709",
    alpha: Array32 | None = None,
    layers: Mapping[Layer, Array32] | None = None,
    storage: ExrStorage = "float",
) -> None:
    """Write light [H, W, C] of a scene as EXR: of bands a channel each, else in the primaries of a space.

    Args:
        path: File.
        light: Light of the bands, or linear Rec.709, in the unit of `header`.
        header: Attributes of the EXR (`header_of`, `seen_by`).
        bands: Bands of the light; empty: red, green and blue.
        space: Space to whose primaries Rec.709 is converted; it does not affect bands.
        alpha: Alpha [H, W], written as channel A, by which the light is premultiplied already.
        layers: Data [H, W] or [H, W, 3] by layer, each written in a part of its name.
        storage: Storage of the light, as in `write_exr`.

    Raises:
        StorageError: The disk refuses.
        InputError: A value does not fit into the storage.
    """
    header, primaries = dict(header), None
    if bands:
        header |= LAYOUT
    else:
        light, primaries = light @ space_from_rec709(space).astype(np.float32).T, SPACE_PRIMARIES[space]
    planes = {channel: light[..., index] for index, channel in enumerate(channels(bands))}
    if alpha is not None:
        planes["A"] = alpha
    data: dict[str, dict[str, Array32]] = {}
    for layer, values in (layers or {}).items():
        split = np.moveaxis(np.atleast_3d(values), -1, 0)
        data[layer] = dict(zip(CHANNELS[layer], split, strict=True))
        header[f"rig:{layer}"] = NOTES[layer]
    write_exr(path, planes, primaries=primaries, attributes=header, data=data, storage=storage)


def header_of(record: ModelRecord, name: str, factor: float = 1.0) -> dict[str, ExrValue]:
    """Return what the header of an EXR says of light times `factor`; name: of what is seen."""
    absolute = (
        {} if record.luminance is None else white_luminance(*(part / factor for part in record.luminance))
    )
    return {
        **absolute,
        "software": f"rig {version('hdr-rig')}",
        "rig:view": name,
        "rig:units": f"light times {EXPOSURE_FACTOR}; light is linear radiance {record.radiance}",
        EXPOSURE_FACTOR: factor,
    }


def seen_by(camera: SplatCamera) -> dict[str, ExrValue]:
    """Return what the header of an EXR says of its camera, as a pinhole."""
    return camera_attributes(camera.cam_from_world, camera.K, (camera.width, camera.height))
