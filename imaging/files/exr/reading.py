"""Reading of OpenEXR files, of one or several parts."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from imaging.arguments import checked
from imaging.arrays import AnyArray, Array32, Integers
from imaging.compute import memory
from imaging.files.exr import layers, library
from imaging.files.exr.image import ASPECT, STRUCTURE, Attribute, ExrImage, Planes
from imaging.files.tags.exr_colour import DATA, INTEROP_ID

_MOST_BEYOND = 1 << 12
"""Pixels by which a tile may be larger than the window that it is of."""


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
    parts = library.parts(path)
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
        raise library.deep(path)
    try:
        return {name: _on_display(plane, data, display) for name, plane in pixels.items()}
    except (ValueError, MemoryError) as error:  # a damaged window that no image fits
        raise library.damaged(path) from error


def _check_size(path: Path) -> None:
    """InputError, before any pixel is read, if those of the file do not fit the memory.

    The library reads every part.
    """
    headers = library.headers(path)
    for header in headers:
        if header.get("type") in (OpenEXR.deepscanline, OpenEXR.deeptile):
            raise library.deep(path)
    samples = 0
    for header, name in (*((header, "dataWindow") for header in headers), (headers[0], "displayWindow")):
        window, channels = _window(header, name), len(header["channels"])
        height, width = (int(side) for side in window[1] - window[0] + 1)
        memory.check_picture(str(path), width, height, channels)
        samples += width * height * channels
        tile = header.get("tiles")
        if tile is not None:  # each is decoded whole, however much of it lies beyond the window
            if tile.xSize > width + _MOST_BEYOND or tile.ySize > height + _MOST_BEYOND:
                raise library.damaged(path)
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
    headers = library.headers(path)
    return ExrImage({}, _attributes(headers[_light_part(headers)]))


def _light_part(headers: Sequence[Mapping[str, Any]]) -> int:
    """Number of the part that is the light: of several the one that is called so, else the first."""
    holding = [
        number
        for number, header in enumerate(headers)
        if header.get(INTEROP_ID) != DATA
        and layers.holds_light({channel.name for channel in header["channels"]})
    ]
    named = [number for number in holding if layers.is_picture(str(headers[number].get("name", "")))]
    return next(iter([*named, *holding]), 0)


def _attributes(header: Mapping[str, Any]) -> dict[str, Attribute]:
    attributes = {name: _attribute(value) for name, value in header.items() if name not in STRUCTURE}
    if header.get(ASPECT, 1.0) != 1:
        attributes[ASPECT] = float(header[ASPECT])
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
