"""Addresses of registers, by the committee's own node map, and invalid numbers."""

from typing import Any

import pytest

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.nodemap import NodeMap
from tests.drivers.genicam.judge import judge_of
from tests.drivers.u3v.test_judges import HEAD

from .nodes import Bytes, node_map

NODES = """
<Integer Name="Base"><Value>0x40</Value></Integer>
<Integer Name="Index"><Value>3</Value><Min>0</Min><Max>7</Max></Integer>
<IntReg Name="Offset"><Address>0x08</Address><Length>1</Length><AccessMode>RW</AccessMode>
  <pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></IntReg>
"""
KNIFE = (
    '<IntSwissKnife Name="KNIFE"><pVariable Name="I">Index</pVariable><pVariable Name="O">Offset</pVariable>'
    '<Constant Name="WIDE">2</Constant><Formula>I * WIDE + O</Formula></IntSwissKnife>'
)
TAIL = (
    "<Length>2</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign>"
    "<Endianess>LittleEndian</Endianess>"
)
MASKED = TAIL.replace("<Sign>", "<LSB>4</LSB><MSB>11</MSB><Sign>")
PLACES = {
    "knife": KNIFE,
    "address and knife": f"<Address>0x10</Address>{KNIFE}",
    "address, node and knife": f"<Address>0x10</Address><pAddress>Base</pAddress>{KNIFE}",
    "two knives": KNIFE + KNIFE.replace("KNIFE", "OTHER").replace("WIDE", "SLIM"),
    "knife and index": f'{KNIFE}<pIndex Offset="4">Index</pIndex>',
}
REGISTERS = {
    **{name: f'<IntReg Name="X">{place}{TAIL}</IntReg>' for name, place in PLACES.items()},
    "masked": f'<MaskedIntReg Name="X">{KNIFE}{MASKED}</MaskedIntReg>',
    "entry": (
        f"<StructReg Comment='S'>{KNIFE}{TAIL.replace('<Sign>Unsigned</Sign>', '')}"
        '<StructEntry Name="X"><LSB>4</LSB><MSB>11</MSB></StructEntry></StructReg>'
    ),
}


def filled() -> Bytes:
    memory = Bytes()
    memory.data[:] = range(256)
    memory.data[8] = 0x20
    return memory


@pytest.mark.parametrize("register", REGISTERS.values(), ids=REGISTERS.keys())
def test_a_formula_in_place_is_part_of_the_address(register: str) -> None:
    genapi: Any = pytest.importorskip("genicam.genapi", reason="the package genicam is not installed")
    theirs, ours = filled(), filled()

    xml = f'{HEAD}{NODES}{register}<Port Name="Device"/></RegisterDescription>'
    judge, _port = judge_of(genapi, xml, theirs.read, theirs.write)
    nodes = node_map(NODES + register, ours)
    for index, offset in ((3, 0x20), (0, 0x30), (7, 0x00)):
        for name, value in (("Index", index), ("Offset", offset)):
            judge.get_node(name).value = value
            nodes.set(name, value)
        assert nodes.number("X") == judge.get_node("X").value
        judge.get_node("X").value = 0x5A
        nodes.set("X", 0x5A)
        assert ours.writes[-1] == theirs.writes[-1]
        assert ours.data == theirs.data


@pytest.mark.parametrize(
    ("inside", "why"),
    [
        ("", "no address"),
        ("<Address>0x10</Address><Bank>2</Bank>", "a Bank, which rig does not know"),
        ("<SwissKnife><Formula>16</Formula></SwissKnife>", "a SwissKnife, which rig does not know"),
        (f"<Address>{(1 << 63) - 1}</Address>" * 3, "its register is at"),
        ("<IntSwissKnife><Formula>0 - 1</Formula></IntSwissKnife>", "its register is at -1"),
        ("<IntSwissKnife><Formula>1 / 0</Formula></IntSwissKnife>", "no value"),
    ],
)
def test_a_place_that_is_not_understood_is_neither_read_nor_written(inside: str, why: str) -> None:
    memory = filled()
    nodes = node_map(f'<IntReg Name="X">{inside}{TAIL}</IntReg>', memory)
    for act in (lambda: nodes.number("X"), lambda: nodes.set("X", 1)):
        with pytest.raises(CameraProtocol, match=f"the camera: X: .*{why}"):
            act()
    assert not memory.writes


@pytest.mark.parametrize("port", ["<EventID>1A</EventID>", "<pChunkID>Base</pChunkID>"])
def test_what_comes_with_an_event_is_not_taken_for_the_devices_memory(port: str) -> None:
    memory = filled()
    register = f'<IntReg Name="X"><Address>16</Address>{TAIL.replace("Device", "Event")}</IntReg>'
    nodes = node_map(f'{NODES}{register}<Port Name="Event">{port}</Port>', memory)
    for act in (lambda: nodes.number("X"), lambda: nodes.set("X", 1)):
        with pytest.raises(CameraProtocol, match="its port has a"):
            act()
    assert not memory.writes


class Counted(Bytes):
    """Memory that counts its reads."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = 0

    def read(self, address: int, size: int) -> bytes:
        self.reads += 1
        return super().read(address, size)


def chain(kind: str, length: int) -> str:
    """Nodes of which each asks the next one twice; the last is a register that counts up."""
    bodies = {
        "formula": '<IntSwissKnife Name="N{0}"><pVariable Name="X">N{1}</pVariable><Formula>X + X</Formula>'
        "</IntSwissKnife>",
        "expression": '<IntSwissKnife Name="N{0}"><pVariable Name="X">N{1}</pVariable>'
        '<Expression Name="A">X + X</Expression><Expression Name="B">A + A</Expression>'
        "<Formula>(B + B) / 4</Formula></IntSwissKnife>",
        "two nodes": '<IntSwissKnife Name="N{0}"><pVariable Name="X">N{1}</pVariable>'
        '<pVariable Name="Y">M{1}</pVariable><Formula>X + Y</Formula></IntSwissKnife>'
        '<Integer Name="M{0}"><pValue>N{0}</pValue></Integer>',
        "index": '<Integer Name="N{0}"><pIndex>N{1}</pIndex><pValueDefault>N{1}</pValueDefault></Integer>',
        "address": '<IntReg Name="N{0}"><pAddress>N{1}</pAddress><pAddress>N{1}</pAddress><Length>1</Length>'
        "<AccessMode>RO</AccessMode><pPort>Device</pPort></IntReg>",
    }
    nodes = "".join(bodies[kind].format(index, index + 1) for index in range(length))
    last = f"<Address>0</Address>{TAIL}"
    return (
        f'{nodes}<IntReg Name="N{length}">{last}</IntReg><Integer Name="M{length}"><pValue>N{length}</pValue>'
        "</Integer>"
    )


@pytest.mark.timeout(20)
@pytest.mark.parametrize("kind", ["formula", "expression", "two nodes", "index", "address"])
def test_what_is_asked_for_twice_is_found_out_once(kind: str) -> None:
    memory, length = Counted(), 40
    nodes = node_map(chain(kind, length), memory)
    memory.data[0] = 1
    value = nodes.number("N0")
    if kind not in ("index", "address"):
        assert value == 1 << length
    assert memory.reads <= length + 1
    # The next question is a new one.
    memory.data[0] = 0
    assert nodes.number("N0") == 0


def test_what_was_set_is_seen_by_what_is_computed_from_it() -> None:
    memory = Bytes()
    nodes = node_map(
        '<Converter Name="C"><pVariable Name="S">Scale</pVariable><FormulaTo>FROM * S</FormulaTo>'
        "<FormulaFrom>TO / S</FormulaFrom><pValue>N</pValue></Converter>"
        '<Integer Name="N"><pValue>R</pValue><pMax>Twice</pMax><pValueCopy>Copy</pValueCopy></Integer>'
        '<Integer Name="Scale"><Value>2</Value></Integer><Integer Name="Copy"><pValue>S</pValue></Integer>'
        '<IntSwissKnife Name="Twice"><pVariable Name="V">S</pVariable><Formula>2 * V + 8</Formula>'
        f'</IntSwissKnife><IntReg Name="R"><Address>0x10</Address>{TAIL}</IntReg>'
        f'<IntReg Name="S"><Address>0x12</Address>{TAIL}</IntReg>',
        memory,
    )
    for value, most in ((4, 24), (12, 56), (28, 120)):
        nodes.set("C", value)
        assert (nodes.number("N"), nodes.number("C"), nodes.limits("N").high) == (2 * value, value, most)
    nodes.set("Scale", 4)
    assert nodes.number("C") == 14


NUMBERS = ("nan", "NaN", "inf", "-inf", "1e999", "")


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize(
    "inside",
    [
        '<Integer Name="X"><pValue>F</pValue></Integer><Float Name="F"><Value>{0}</Value></Float>',
        '<Enumeration Name="X"><EnumEntry Name="A"><Value>1</Value></EnumEntry><pValue>F</pValue>'
        '</Enumeration><Float Name="F"><Value>{0}</Value></Float>',
        '<Float Name="X"><Value>{0}</Value></Float>',
        '<Integer Name="X"><pIndex>F</pIndex><ValueDefault>1</ValueDefault></Integer>'
        '<Float Name="F"><Value>{0}</Value></Float>',
        '<Integer Name="X"><pIndex>I</pIndex><ValueIndexed Index="1">{0}</ValueIndexed>'
        '<ValueDefault>1</ValueDefault></Integer><Integer Name="I"><Value>1</Value></Integer>',
        '<Integer Name="X"><pIndex>I</pIndex><ValueIndexed Index="{0}x">2</ValueIndexed>'
        '<ValueDefault>1</ValueDefault></Integer><Integer Name="I"><Value>1</Value></Integer>',
        '<IntReg Name="X"><Address>{0}</Address>' + TAIL + "</IntReg>",
        '<IntReg Name="X"><pAddress>F</pAddress>'
        + TAIL
        + '</IntReg><Float Name="F"><Value>{0}</Value></Float>',
        '<IntReg Name="X"><Address>0</Address><Length>{0}</Length><pPort>Device</pPort></IntReg>',
        '<MaskedIntReg Name="X"><Address>0</Address><Length>2</Length><Bit>{0}</Bit></MaskedIntReg>',
        '<SwissKnife Name="X"><pVariable Name="F">F</pVariable><Formula>F</Formula></SwissKnife>'
        '<Float Name="F"><Value>{0}</Value></Float>',
    ],
)
def test_numbers_that_are_none_end_in_our_error(inside: str, number: str) -> None:
    nodes = node_map(inside.format(number))
    with pytest.raises(CameraProtocol, match="the camera: X: "):
        nodes.number("X")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize("kind", ["Integer", "Float", "Boolean", "Enumeration"])
def test_no_number_that_is_none_can_be_set(kind: str, value: float) -> None:
    inside = '<EnumEntry Name="A"><Value>1</Value></EnumEntry>' if kind == "Enumeration" else ""
    nodes: NodeMap = node_map(f'<{kind} Name="X">{inside}<Value>1</Value></{kind}>')
    with pytest.raises(CameraRefused, match=r"X: .* is no finite number: give another value"):
        nodes.set("X", value)


@pytest.mark.parametrize("size", [4, 8])
def test_a_float_register_that_holds_no_number_is_told(size: int) -> None:
    memory = Bytes()
    memory.data[:] = b"\xff" * 256
    nodes = node_map(
        f'<FloatReg Name="X"><Address>0</Address><Length>{size}</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort></FloatReg>",
        memory,
    )
    with pytest.raises(CameraProtocol, match="X: nan is no number"):
        nodes.number("X")
    nodes.set("X", 2.0)
    assert nodes.number("X") == 2.0
