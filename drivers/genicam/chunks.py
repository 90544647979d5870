"""Chunks: what a camera appends to the image in a payload, each with its ChunkID and length after it."""

import struct
from typing import Literal

from drivers.errors import CameraProtocol
from imaging.arrays import Bytes

ByteOrder = Literal["little", "big"]
CHUNKS = 0x4000
"""The bit of a payload type that says that chunks follow the image."""
_TAGS = {"little": struct.Struct("<II"), "big": struct.Struct(">II")}
"""USB3 Vision is little endian, GigE Vision big."""


class ChunksRefused(CameraProtocol):
    """A payload whose chunks are not understood; without them the frame may be."""


def split_chunks(payload: Bytes, order: ByteOrder) -> tuple[Bytes, dict[int, bytes]]:
    """The image, which comes first, and the other chunks by ChunkID. ChunksRefused if they do not add up."""
    tag = _TAGS[order]
    chunks: dict[int, bytes] = {}
    end = len(payload)
    while end >= tag.size:
        name, size = tag.unpack(payload[end - tag.size : end].tobytes())
        begin = end - tag.size - size
        if begin < 0:
            break
        if begin == 0:
            return payload[:size], chunks
        chunks[name] = payload[begin : begin + size].tobytes()
        end = begin
    raise ChunksRefused(f"the chunks of a payload of {len(payload)} bytes do not add up")


def join_chunks(parts: list[tuple[int, bytes]], order: ByteOrder) -> bytes:
    """A payload of chunks, the image first."""
    return b"".join(data + _TAGS[order].pack(name, len(data)) for name, data in parts)
