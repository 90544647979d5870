"""Registers bit by bit: sizes, byte orders, masks, texts, addresses."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraRefused

from .nodes import Bytes, node_map, register


@pytest.mark.parametrize("size", [1, 2, 3, 4, 8])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("signed", [False, True])
@given(st.data())
def test_int_registers(size: int, big: bool, signed: bool, data: st.DataObject) -> None:
    memory = Bytes()
    inside = (
        f"<Length>{size}</Length><Sign>{'Signed' if signed else 'Unsigned'}</Sign>"
        f"<Endianess>{'BigEndian' if big else 'LittleEndian'}</Endianess>"
    )
    nodes = node_map(register("IntReg", inside), memory)
    low = -(2 ** (8 * size - 1)) if signed else 0
    value = data.draw(st.integers(low, low + 2 ** (8 * size) - 1))
    nodes.set("R", value)
    assert memory.writes == [(0x10, value.to_bytes(size, "big" if big else "little", signed=signed))]
    assert nodes.number("R") == value
    with pytest.raises(CameraRefused, match="the camera: R: "):
        nodes.set("R", low - 1)


@given(
    st.integers(0, 31),
    st.integers(0, 31),
    st.booleans(),
    st.binary(min_size=4, max_size=4),
    st.integers(0, 2**32 - 1),
)
def test_masked_registers_leave_the_other_bits(
    first: int, last: int, big: bool, before: bytes, value: int
) -> None:
    memory = Bytes()
    memory.data[16:20] = before
    order = "BigEndian" if big else "LittleEndian"
    low, high = min(first, last), max(first, last)
    # In big endian registers bit 0 is the highest, and the least significant bit has the larger number.
    lsb, msb = (high, low) if big else (low, high)
    inside = f"<Length>4</Length><LSB>{lsb}</LSB><MSB>{msb}</MSB><Endianess>{order}</Endianess>"
    nodes = node_map(register("MaskedIntReg", inside), memory)
    text = "".join(f"{byte:08b}" for byte in (before if big else before[::-1]))  # Highest bit first.
    places = range(low, high + 1) if big else range(31 - high, 32 - low)
    assert nodes.number("R") == int("".join(text[place] for place in places), 2)
    width = high - low + 1
    value %= 1 << width
    nodes.set("R", value)
    assert nodes.number("R") == value
    after = "".join(f"{byte:08b}" for byte in (memory.data[16:20] if big else memory.data[16:20][::-1]))
    assert [after[place] for place in range(32) if place not in places] == [
        text[place] for place in range(32) if place not in places
    ]
    if width < 32:
        with pytest.raises(CameraRefused):
            nodes.set("R", 1 << width)


def test_signed_bits() -> None:
    memory = Bytes()
    memory.data[16:20] = struct.pack("<I", 0xD << 4)
    nodes = node_map(
        register("MaskedIntReg", "<Length>4</Length><LSB>4</LSB><MSB>7</MSB><Sign>Signed</Sign>"), memory
    )
    assert nodes.number("R") == -3
    assert (nodes.limits("R").low, nodes.limits("R").high) == (-8, 7)


@pytest.mark.parametrize(("size", "code"), [(4, "f"), (8, "d")])
@pytest.mark.parametrize("big", [False, True])
def test_float_registers(size: int, code: str, big: bool) -> None:
    memory = Bytes()
    order = "BigEndian" if big else "LittleEndian"
    inside = f"<Length>{size}</Length><Endianess>{order}</Endianess>"
    nodes = node_map(register("FloatReg", inside), memory)
    nodes.set("R", 0.15625)
    assert memory.writes == [(0x10, struct.pack((">" if big else "<") + code, 0.15625))]
    assert nodes.number("R") == 0.15625


def test_texts() -> None:
    memory = Bytes()
    nodes = node_map(register("StringReg", "<Length>8</Length>"), memory)
    nodes.set("R", "Müller")
    assert memory.data[16:24] == "Müller".encode() + b"\0"
    assert nodes.text("R") == "Müller"
    with pytest.raises(CameraRefused, match="8 bytes"):
        nodes.set("R", "Müllerin1")


def test_addresses_add_up() -> None:
    memory = Bytes()
    memory.data[:] = range(256)
    nodes = node_map(
        '<IntReg Name="A"><Address>0x10</Address><Address>2</Address><pAddress>Base</pAddress>'
        '<pIndex Offset="4">Index</pIndex><pIndex pOffset="Step">Index</pIndex><Length>1</Length>'
        "<AccessMode>RO</AccessMode><pPort>Device</pPort></IntReg>"
        '<Integer Name="Base"><Value>0x40</Value></Integer><Integer Name="Index"><Value>3</Value></Integer>'
        '<Integer Name="Step"><Value>5</Value></Integer>',
        memory,
    )
    assert nodes.number("A") == 0x10 + 2 + 0x40 + 3 * 4 + 3 * 5
    nodes.set("Index", 0)
    assert nodes.number("A") == 0x52


def test_struct_entries_share_a_register() -> None:
    memory = Bytes()
    nodes = node_map(
        '<StructReg Comment="C"><Address>4</Address><Length>2</Length><AccessMode>RW</AccessMode>'
        '<pPort>Device</pPort><Endianess>LittleEndian</Endianess><StructEntry Name="Low"><Bit>0</Bit>'
        '</StructEntry><StructEntry Name="High"><AccessMode>RO</AccessMode><LSB>12</LSB><MSB>15</MSB>'
        "</StructEntry></StructReg>",
        memory,
    )
    memory.data[4:6] = b"\x00\xa5"
    nodes.set("Low", 1)
    assert memory.data[4:6] == b"\x01\xa5"
    assert nodes.number("High") == 10
    assert not nodes.writable("High")


@pytest.mark.parametrize(("access", "letter"), [("RO", "R"), ("WO", "W")])
def test_registers_for_one_direction(access: str, letter: str) -> None:
    memory = Bytes()
    nodes = node_map(
        register("MaskedIntReg", "<Length>2</Length><LSB>0</LSB><MSB>3</MSB>", access)
        + '<Integer Name="N"><pValue>R</pValue></Integer>',
        memory,
    )
    assert nodes.writable("N") == (letter == "W")
    if letter == "W":
        nodes.set("N", 3)
        assert memory.writes == [(0x10, b"\x03\x00")]
        with pytest.raises(CameraRefused):
            nodes.number("N")


def test_chunks_are_read_from_the_frame() -> None:
    inside = (
        '<FloatReg Name="T"><Address>4</Address><Length>8</Length><AccessMode>RO</AccessMode>'
        '<pPort>Chunk</pPort></FloatReg><Port Name="Chunk"><ChunkID>1A</ChunkID></Port>'
    )
    nodes = node_map(inside)
    with pytest.raises(CameraRefused, match="T: no chunk"):
        nodes.number("T")
    nodes.attach_chunks({0x1A: bytes(4) + struct.pack("<d", 2.5)})
    assert nodes.number("T") == 2.5
    nodes.attach_chunks({0x1A: bytes(11)})
    with pytest.raises(CameraRefused):
        nodes.number("T")
