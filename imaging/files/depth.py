"""Depth maps of laser scanners, phones and renderers: PNG or TIFF of 16 bits, EXR, NumPy arrays."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from imaging.arrays import AnyArray, Array32
from imaging.compute.memory import check_picture
from imaging.errors import InputError
from imaging.files.exr.layers import depth_channel
from imaging.files.exr.reading import read_exr
from imaging.files.photo import decode_codes

SUFFIXES = (".png", ".tif", ".tiff", ".exr", ".npy")
MILLIMETRE = 1e-3
"""Unit of whole numbers, as nerfstudio, Polycam and Record3D have it, in units of the world."""
_LAST = np.iinfo(np.uint16).max
_FIX = "export it again"


def read_depth(path: Path) -> tuple[Array32, bool]:
    """Depth along the axis of the camera, float32 [H, W], and whether the file has whole numbers.

    In the unit of the file. Unknown depth is 0: zeros, negative and non-finite numbers, and the largest
    16-bit code, where sensors saturate. InputError when the file is missing, damaged or no depth map.
    """
    name = f"The depth map {path}"
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{name} cannot be read ({(error.strerror or 'error').lower()}): "
            "restore it, or import again without depths."
        ) from error
    suffix = path.suffix.lower()
    if suffix == ".exr":
        return _known(_of_exr(path, name)), False
    if suffix == ".npy":
        values = _of_array(data, name)
        whole = values.dtype.kind in "iu"
        return _known(values), whole
    codes = decode_codes(data, name, _FIX)
    if codes.dtype != np.uint16 or codes.shape[2] != 1:
        raise InputError(
            f"{name} is a picture of {8 * codes.dtype.itemsize} bits and {codes.shape[2]} channels: export "
            "depth as grey of 16 bits, in millimetres."
        )
    return _known(np.where(codes[..., 0] == _LAST, 0, codes[..., 0])), True


def require_shape(path: Path, depth: Array32, height: int, width: int) -> None:
    """Check that a depth map has the proportions of its photograph, to a row or a column.

    Scanners have fewer pixels than cameras: its pixels are evenly over the photograph.

    Args:
        path: File of the depth map, as the error names it.
        depth: Depth map [h, w].
        height: Height of the photograph, px.
        width: Width of the photograph, px.

    Raises:
        InputError: The proportions differ.
    """
    rows, columns = depth.shape
    if abs(rows - height * columns / width) > 1 and abs(columns - width * rows / height) > 1:
        raise InputError(
            f"The depth map {path} has {columns}x{rows} pixels and its photograph {width}x{height}: "
            "export it in the proportions of the photograph."
        )


def _known(values: AnyArray) -> Array32:
    with np.errstate(over="ignore", invalid="ignore"):
        depth = np.asarray(values, np.float32)
        return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))


def _of_exr(path: Path, name: str) -> Array32:
    channels = read_exr(path).channels
    channel = depth_channel(channels)
    if channel:
        return channels[channel]
    names = ", ".join(sorted(channels))
    raise InputError(f"{name} has channels {names}, and none is depth: name it Z.")


def _of_array(data: bytes, name: str) -> AnyArray:
    try:
        shape, _, kind = _header(data)
        if kind.kind not in "iuf" or len(shape) not in (2, 3) or 0 in shape or shape[2:] not in ((), (1,)):
            raise ValueError("no picture")
        check_picture(name, shape[1], shape[0])
        return np.asarray(np.load(BytesIO(data), allow_pickle=False)).reshape(shape[:2])
    except InputError:
        raise
    except Exception as error:  # NumPy raises whatever damaged bytes make it trip over
        raise InputError(f"{name} is damaged or no array [H, W] of numbers: {_FIX}.") from error


def _header(data: bytes) -> Any:
    """Shape, order and dtype of an array, before its numbers are read."""
    file = BytesIO(data)
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    return read(file)
