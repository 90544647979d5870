"""Writing of OpenEXR files: linear light in float, with what is needed to know which light."""

import errno
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from imaging.arguments import checked
from imaging.arrays import AnyArray
from imaging.choices import ExrStorage
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr.image import STRUCTURE, Planes
from imaging.files.silence import quiet
from imaging.files.tags.exr_colour import DATA, IDS, INTEROP_ID, UNKNOWN
from imaging.optics.exposure import Exposure

ExrValue = str | float | Fraction | AnyArray
"""Value of an attribute, beside types of OpenEXR's own: an array is a matrix [4, 4]."""
LATLONG: Mapping[str, Any] = {"envmap": OpenEXR.ENVMAP_LATLONG}
"""Attribute of a map of latitude and longitude."""
EXPOSURE_FACTOR = "rig:exposureFactor"
"""Attribute of every file of ours: its values are light in the unit of the calibration times this."""
LIGHT = "light"
"""The part of a file of several that is no data."""
_OF_ALL_PARTS = "timeCode"
"""Attribute that the format wants alike in every part of a file."""
_AS_LINES = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
_DWAA = {"compression": OpenEXR.DWAA_COMPRESSION}


@checked
def write_exr(
    path: str | Path,
    channels: AnyArray | Planes,
    *,
    storage: ExrStorage = "float",
    primaries: str | None = "rec709",
    exposure: Exposure | None = None,
    attributes: Mapping[str, ExrValue] | None = None,
    data: Mapping[str, Planes] | None = None,
) -> None:
    """Write linear light, whole or not at all.

    NaN and infinities are kept.

    Args:
        path: File.
        channels: [H, W, 3] as R, G, B; [H, W] as Y; or arrays [H, W] by name.
        storage: Of the light: float32; `half`, float16; or `dwaa`, float16 whose R, G and B or Y are
            compressed with loss. All else is compressed by ZIP.
        primaries: Entry of `IDS` in `imaging.files.tags.exr_colour`; None: unknown, which the file states.
        exposure: Exposure to write as `expTime`, `aperture` and `isoSpeed`.
        attributes: Values by name (`rig:...` for our own, or OpenEXR's, as `whiteLuminance`); numbers become
            float32, and matrices too.
        data: Channels other than light, of the same size, float32 by the name of the part that holds them;
            the light is then in a part `light` before them.

    Raises:
        StorageError: The disk refuses.
        InputError: A finite value is too large for the type, or one that is not finite is for DWAA.
        ValueError: The shapes or names are invalid.
    """
    path = Path(path)
    light = _planes(channels)
    header: dict[str, Any] = {INTEROP_ID: _interop_id(light, primaries)}
    if exposure is not None:
        settings = {"expTime": exposure.time, "aperture": exposure.f_number, "isoSpeed": exposure.iso}
        header |= {name: float(value) for name, value in settings.items() if value is not None}
    for name, value in (attributes or {}).items():
        if name in STRUCTURE:
            raise ValueError(f"{name!r} belongs to the structure of an EXR")
        if isinstance(value, np.ndarray):
            header[name] = np.ascontiguousarray(value, np.float32)
        else:
            header[name] = float(value) if isinstance(value, int | float | np.number) else value
    # OpenEXR asks for some attributes to be the same in every part.
    shared = {name: value for name, value in header.items() if name == _OF_ALL_PARTS}
    if storage == "dwaa":
        header |= _DWAA
    parts = {LIGHT: (header, light)} | {
        name: ({INTEROP_ID: DATA, **shared}, planes) for name, planes in (data or {}).items()
    }
    # Only light may be lossy: masks and deviations are numbers that others compute with.
    stored = {
        name: (
            attributes_of,
            {
                channel: _stored(path, channel, plane, storage if name == LIGHT else "float")
                for channel, plane in planes.items()
            },
        )
        for name, (attributes_of, planes) in parts.items()
    }
    if len({plane.shape for _, planes in stored.values() for plane in planes.values()}) != 1:
        raise ValueError("the channels of an EXR have one shape")
    # One part is a plain file, which more programs open than they do multi-part ones.
    if data:
        image = OpenEXR.File(
            [
                OpenEXR.Part(_AS_LINES | attributes_of, planes, name)
                for name, (attributes_of, planes) in stored.items()
            ]
        )
    else:
        image = OpenEXR.File(_AS_LINES | header, stored[LIGHT][1])
    with store.replacing(path) as part:
        try:
            with quiet():
                image.write(str(part))
        except RuntimeError as error:  # the library reports a full disk so, in its last sentence
            raise OSError(errno.EIO, str(error).rstrip(".").rpartition(". ")[2]) from error


def white_luminance(value: float, error: float) -> dict[str, float]:
    """Attributes of an EXR whose scale of light is known: OpenEXR's `whiteLuminance`, cd/m2 of RGB (1, 1, 1),
    and its standard error.
    """
    return {"whiteLuminance": value, "rig:whiteLuminanceError": error}


def _interop_id(light: Planes, primaries: str | None) -> str:
    if not all(name in light for name in "RGB"):
        return DATA
    return UNKNOWN if primaries is None else IDS[primaries]


def _planes(channels: AnyArray | Planes) -> dict[str, AnyArray]:
    if isinstance(channels, Mapping):
        return dict(channels)
    if channels.ndim == 3 and channels.shape[2] == 3:
        return {name: channels[..., index] for index, name in enumerate("RGB")}
    return {"Y": channels}


def _stored(path: Path, name: str, plane: AnyArray, storage: ExrStorage) -> AnyArray:
    """A plane in the type that is written; the library takes strided arrays for contiguous ones."""
    if plane.ndim != 2 or plane.size == 0:
        raise ValueError(f"channel {name} is [H, W], not {plane.shape}")
    if storage == "dwaa" and not np.isfinite(plane).all():
        raise InputError(f"{path}: channel {name} has NaN or infinity, which DWAA makes 0: write it as half.")
    kind = np.float32 if storage == "float" else np.float16
    with np.errstate(over="ignore"):
        stored = np.ascontiguousarray(plane, dtype=kind)
    if np.any(np.isinf(stored) & np.isfinite(plane)):
        fix = "scale it down" if storage == "float" else "write it as float"
        raise InputError(f"{path}: channel {name} exceeds {np.finfo(kind).max:g}, the largest value: {fix}.")
    return stored
