"""Chunks: what a camera appends to the image in a payload, each with its ChunkID and length after it."""

import struct

import numpy as np
import numpy.typing as npt

from drivers.errors import CameraProtocol

_TAG = struct.Struct("<II")


def split_chunks(payload: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[np.uint8], dict[int, bytes]]:
    """The image, which comes first, and the other chunks by ChunkID. CameraProtocol if they do not add up."""
    chunks: dict[int, bytes] = {}
    end = len(payload)
    while end >= _TAG.size:
        name, size = _TAG.unpack(payload[end - _TAG.size : end].tobytes())
        begin = end - _TAG.size - size
        if begin < 0:
            break
        if begin == 0:
            return payload[:size], chunks
        chunks[name] = payload[begin : begin + size].tobytes()
        end = begin
    raise CameraProtocol(f"the chunks of a payload of {len(payload)} bytes do not add up")


def join_chunks(parts: list[tuple[int, bytes]]) -> bytes:
    """A payload of chunks, the image first."""
    return b"".join(data + _TAG.pack(name, len(data)) for name, data in parts)
