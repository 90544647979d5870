"""Frames whose leaders omit the size and the pixel format."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from drivers.genicam.chunks import CHUNKS, join_chunks
from drivers.genicam.mosaics import Mosaics
from drivers.genicam.session import Frame, FrameLeader, Session
from imaging.optics.exposure import Exposure

from .nodemap.nodes import node_map

MONO8 = 0x01080001


def chunk(name: str, number: str) -> str:
    return (
        f'<IntReg Name="{name}"><Address>0</Address><Length>4</Length><AccessMode>RO</AccessMode>'
        f'<pPort>{name}Port</pPort><Endianess>BigEndian</Endianess></IntReg><Port Name="{name}Port">'
        f"<ChunkID>{number}</ChunkID></Port>"
    )


SETTINGS = "".join(
    f'<Integer Name="{name}"><Value>{value}</Value></Integer>'
    for name, value in (("PixelFormat", MONO8), ("Width", 4), ("Height", 2))
)
DESCRIBED = chunk("ChunkWidth", "1003") + chunk("ChunkHeight", "1004") + chunk("ChunkPixelFormat", "1005")


@pytest.mark.parametrize(("described", "sent"), [("", ()), (DESCRIBED, ()), (DESCRIBED, (2, 4))])
def test_the_camera_states_what_neither_leader_nor_chunks_do(described: str, sent: tuple[int, ...]) -> None:
    """sent: chunks of width and height."""
    chunks = [(0x1003 + at, size.to_bytes(4, "big")) for at, size in enumerate(sent)]
    payload = join_chunks([(0x1001, bytes(range(8))), *chunks], "big")
    nodes = node_map(SETTINGS + described)
    session = SimpleNamespace(nodes=nodes, chunk_order="big", where="GigE 10.0.0.2", make="A", model="B")
    frame = Frame(FrameLeader(1, 1 | CHUNKS, 0), np.frombuffer(payload, np.uint8), None)
    mosaic = Mosaics(cast(Session, session), "1").of(frame, Exposure(time=0.01))
    width, height = sent or (4, 2)
    assert np.array_equal(mosaic.pixels, np.arange(8).reshape(height, width))
