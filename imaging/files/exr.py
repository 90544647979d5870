"""OpenEXR files: linear light in float, with what is needed to know which light."""

import errno
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from imaging.arguments import checked
from imaging.arrays import AnyArray, Array32, Integers
from imaging.choices import ExrStorage
from imaging.compute import memory
from imaging.errors import InputError
from imaging.files import exr_layers, exr_library, store
from imaging.files.silence import quiet
from imaging.files.tags.exr_colour import DATA, IDS, INTEROP_ID, UNKNOWN, colour_of
from imaging.optics.exposure import Exposure

Planes = Mapping[str, AnyArray]
"""Arrays [H, W] by the name of their channel."""
Attribute = str | float | tuple[float, ...]
ExrValue = str | float | Fraction | AnyArray
"""Value of an attribute that is written, beside types of OpenEXR's own: an array is a matrix [4, 4]."""
LATLONG: Mapping[str, Any] = {"envmap": OpenEXR.ENVMAP_LATLONG}
"""Attribute of a map of latitude and longitude."""

_ASPECT = "pixelAspectRatio"
_STRUCTURE = {
    "channels",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    _ASPECT,
    "screenWindowCenter",
    "screenWindowWidth",
    "type",
    "tiles",
    "version",
    "name",
    "chunkCount",
}
_OF_ALL_PARTS = "timeCode"
"""Attribute that the format wants alike in every part of a file."""
_MOST_BEYOND = 1 << 12
"""Pixels by which a tile may be larger than the window that it is of."""
EXPOSURE_FACTOR = "rig:exposureFactor"
"""Attribute of every file of ours: its values are light in the unit of the calibration times this."""
LIGHT = "light"
"""The part of a file of several that is no data."""
_AS_LINES = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
_DWAA = {"compression": OpenEXR.DWAA_COMPRESSION}


@dataclass(frozen=True)
class ExrImage:
    """Channels, each float32 [H, W], by name, and the attributes that are text or numbers.

    light: names of the channels of the part that holds the light; None: all channels.
    """

    channels: dict[str, Array32]
    attributes: dict[str, Attribute] = field(default_factory=dict)
    light: frozenset[str] | None = None

    def rgb(self) -> Array32:
        """Linear Rec.709, float32 [H, W, 3], of the channels that are light (`imaging.files.exr_layers`).

        Another space of linear light that the file names is converted; one that names none is Rec.709.
        InputError if no channels, or several, could be the light, and if the file says that its R, G, B are
        data, or not linear (`imaging.files.tags.exr_colour`).
        """
        names = exr_layers.light_channels(self._names)
        light = np.stack([self.channels[name] for name in names], axis=-1)
        matrix = colour_of(self.attributes).matrix if len(set(names)) == 3 else None
        return light if matrix is None else (light @ matrix.T).astype(np.float32)

    @property
    def alpha(self) -> Array32 | None:
        """Opacity of each pixel, 0..1, float32 [H, W]; None where all is opaque.

        The light of an EXR is multiplied by it: premultiplied, over black. InputError as `rgb`.
        """
        name = exr_layers.alpha_channel(self._names)
        if not name:
            return None
        cover = np.nan_to_num(self.channels[name], nan=1.0).clip(0.0, 1.0)
        return None if (cover == 1).all() else np.asarray(cover, np.float32)

    @property
    def doubt(self) -> str:
        """A sentence if what the file says of its R, G, B or its pixels is not clear; else empty."""
        aspect = self.attributes.get(_ASPECT, 1.0)
        if aspect != 1:
            return f"{_ASPECT} {aspect:g} is not used: pixels count as square unless a lens is given."
        try:
            return colour_of(self.attributes).doubt
        except InputError:  # which `rgb` says, if there are R, G and B at all
            return ""

    @property
    def exposure(self) -> Exposure | None:
        """Exposure from `expTime`, `aperture` and `isoSpeed`; None if the file names no time."""
        time, f_number, iso = (self._positive(name) for name in ("expTime", "aperture", "isoSpeed"))
        return None if time is None else Exposure(time=time, f_number=f_number, iso=iso)

    @property
    def _names(self) -> frozenset[str]:
        return frozenset(self.channels) if self.light is None else self.light

    def _positive(self, name: str) -> float | None:
        value = self.attributes.get(name)
        return value if isinstance(value, float) and 0 < value < float("inf") else None


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
        if name in _STRUCTURE:
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


@checked
def read_exr(path: str | Path) -> ExrImage:
    """Read an EXR file. The pixels are those of the display window; outside the data window they are 0.

    Args:
        path: File of one or several parts.

    Returns:
        Channels float32 [H, W] of all parts, where a name that occurs twice becomes PART.NAME, and the
        attributes of the part that holds the light, else of the first.

    Raises:
        InputError: The file is damaged, deep, subsampled or no EXR.
    """
    path = Path(path)
    _check_size(path)
    parts = exr_library.parts(path)
    parts.insert(0, parts.pop(_light_part([header for header, _ in parts])))
    channels: dict[str, Array32] = {}
    for header, pixels in parts:
        for name, plane in _channels(path, header, pixels).items():
            channels[f"{header.get('name', '')}.{name}" if name in channels else name] = plane
    return ExrImage(channels, _attributes(parts[0][0]), frozenset(parts[0][1]))


def _channels(path: Path, header: Mapping[str, Any], pixels: Planes) -> dict[str, Array32]:
    """The channels of a part on its display window."""
    data, display = (_window(header, name) for name in ("dataWindow", "displayWindow"))
    shape = tuple((data[1] - data[0] + 1).tolist())
    if not pixels or any(plane.dtype == object or plane.shape != shape for plane in pixels.values()):
        raise exr_library.deep(path)
    try:
        return {name: _on_display(plane, data, display) for name, plane in pixels.items()}
    except (ValueError, MemoryError) as error:  # a damaged window that no image fits
        raise exr_library.damaged(path) from error


def _check_size(path: Path) -> None:
    """InputError, before any pixel is read, if those of the file do not fit the memory.

    The library reads every part.
    """
    headers = exr_library.headers(path)
    for header in headers:
        if header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
            raise exr_library.deep(path)
    samples = 0
    for header, name in (*((header, "dataWindow") for header in headers), (headers[0], "displayWindow")):
        window, channels = _window(header, name), len(header["channels"])
        height, width = (int(side) for side in window[1] - window[0] + 1)
        memory.check_picture(str(path), width, height, channels)
        samples += width * height * channels
        tile = header.get("tiles")
        if tile is not None:  # each is decoded whole, however much of it lies beyond the window
            if tile.xSize > width + _MOST_BEYOND or tile.ySize > height + _MOST_BEYOND:
                raise exr_library.damaged(path)
            samples += tile.xSize * tile.ySize * channels
    memory.check(f"{path} has {samples} samples in all", memory.PER_SAMPLE * samples)


def _window(header: Mapping[str, Any], name: str) -> Integers:
    """[[top, left], [bottom, right]], inclusive."""
    return np.array(header[name], np.int64)[:, ::-1]


def _on_display(plane: AnyArray, data: Integers, display: Integers) -> Array32:
    """A plane of the data window on the display window, both [[top, left], [bottom, right]] inclusive."""
    if np.array_equal(data, display):
        return plane.astype(np.float32)
    canvas = np.zeros(display[1] - display[0] + 1, np.float32)
    first, last = np.maximum(data[0], display[0]), np.minimum(data[1], display[1])
    target = tuple(
        slice(a, max(a, b)) for a, b in zip(first - display[0], last - display[0] + 1, strict=True)
    )
    source = tuple(slice(a, max(a, b)) for a, b in zip(first - data[0], last - data[0] + 1, strict=True))
    canvas[target] = plane[source]
    return canvas


def read_exr_header(path: Path) -> ExrImage:
    """The attributes alone, without channels; InputError if it is no EXR file."""
    headers = exr_library.headers(path)
    return ExrImage({}, _attributes(headers[_light_part(headers)]))


def _light_part(headers: Sequence[Mapping[str, Any]]) -> int:
    """Number of the part that is the light: of several the one that is called so, else the first."""
    holding = [
        number
        for number, header in enumerate(headers)
        if header.get(INTEROP_ID) != DATA
        and exr_layers.holds_light({channel.name for channel in header["channels"]})
    ]
    named = [number for number in holding if exr_layers.is_picture(str(headers[number].get("name", "")))]
    return next(iter([*named, *holding]), 0)


def _attributes(header: Mapping[str, Any]) -> dict[str, Attribute]:
    attributes = {name: _attribute(value) for name, value in header.items() if name not in _STRUCTURE}
    if header.get(_ASPECT, 1.0) != 1:
        attributes[_ASPECT] = float(header[_ASPECT])
    return {name: value for name, value in attributes.items() if value is not None}


def _attribute(value: Any) -> Attribute | None:
    if isinstance(value, str):
        return value
    if isinstance(value, bool | int | float | np.number):
        return float(value)
    if isinstance(value, np.ndarray) and value.ndim == 1:  # so the library gives short vectors
        value = tuple(value.tolist())
    if isinstance(value, tuple) and all(isinstance(part, int | float | np.number) for part in value):
        return tuple(float(part) for part in value)
    return None


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
