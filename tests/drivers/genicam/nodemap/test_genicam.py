"""The node map over a memory of its own: limits, access, references, whole numbers of other nodes."""

import pytest

from drivers.errors import CameraProtocol, CameraRefused

from .nodes import Bytes, node_map, register

BEHIND = {
    "Converter": (
        '<Converter Name="K"><FormulaTo>FROM * 10</FormulaTo><FormulaFrom>TO / 10</FormulaFrom>'
        "<pValue>R</pValue></Converter>"
    ),
    "SwissKnife": (
        '<SwissKnife Name="K"><pVariable Name="V">R</pVariable><Formula>V / 10</Formula></SwissKnife>'
    ),
    "Float": (
        '<Float Name="K"><pValue>D</pValue></Float>'
        '<SwissKnife Name="D"><pVariable Name="V">R</pVariable><Formula>V / 10</Formula></SwissKnife>'
    ),
}
ROUNDED = {4: 0, 5: 1, 14: 1, 15: 2, 25: 3, -4: 0, -5: -1, -15: -2, -25: -3}
"""Tenths, and the whole number that genicam 1.6.0 reads, whose halves go away from zero."""


@pytest.mark.parametrize("behind", BEHIND.values(), ids=BEHIND.keys())
def test_an_integer_is_the_nearest_whole_number(behind: str) -> None:
    memory = Bytes()
    inside = "<Length>4</Length><Sign>Signed</Sign><Endianess>BigEndian</Endianess>"
    nodes = node_map(
        f'{register("IntReg", inside)}{behind}<Integer Name="I"><pValue>K</pValue></Integer>'
        '<IntSwissKnife Name="J"><pVariable Name="W">K</pVariable><Formula>W</Formula></IntSwissKnife>',
        memory,
    )
    for tenths, whole in ROUNDED.items():
        memory.data[16:20] = tenths.to_bytes(4, "big", signed=True)
        assert (nodes.number("I"), nodes.number("J")) == (whole, whole)


def test_the_extended_exposure_of_a_shado_box() -> None:
    """Of an interval of 0 it is (0 + 43970) / 65 - 1304.2, of 100,000 910.72."""
    memory = Bytes()
    nodes = node_map(
        register("IntReg", "<Length>4</Length><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess>")
        + '<Integer Name="ExtendedExposure"><pValue>K</pValue></Integer><Converter Name="K">'
        "<FormulaTo>(FROM+1304.2)*65-43970</FormulaTo><FormulaFrom>(TO+43970)/65-1304.2</FormulaFrom>"
        "<pValue>R</pValue></Converter>",
        memory,
    )
    assert nodes.number("ExtendedExposure") == -628
    memory.data[16:20] = (100_000).to_bytes(4, "little")
    assert nodes.number("ExtendedExposure") == 911


LIMITED = (
    '<Integer Name="N"><pValue>R</pValue><pMin>Low</pMin><Max>40</Max><Inc>4</Inc></Integer>'
    '<Integer Name="Low"><Value>8</Value></Integer>' + register("IntReg", "<Length>2</Length>")
)


@pytest.mark.parametrize("value", [4, 9, 44, -8])
def test_integers_keep_to_their_limits(value: int) -> None:
    nodes = node_map(LIMITED)
    with pytest.raises(CameraRefused, match=r"N: .* is not in 8 to 40 in steps of 4"):
        nodes.set("N", value)
    nodes.set("N", 12)
    assert nodes.number("N") == 12
    nodes.set("Low", 16)
    assert nodes.limits("N").low == 16


ENUMERATION = (
    '<Enumeration Name="E"><EnumEntry Name="One"><Value>1</Value></EnumEntry>'
    '<EnumEntry Name="Two"><pIsAvailable>Switch</pIsAvailable><Value>2</Value></EnumEntry>'
    '<EnumEntry Name="Never"><pIsImplemented>No</pIsImplemented><Value>3</Value></EnumEntry>'
    "<pValue>R</pValue></Enumeration>"
    '<Boolean Name="Switch"><Value>false</Value></Boolean><Integer Name="No"><Value>0</Value></Integer>'
    + register("IntReg", "<Length>4</Length>")
)


def test_enumerations_offer_what_is_available() -> None:
    nodes = node_map(ENUMERATION)
    nodes.set("E", "One")
    assert (nodes.text("E"), nodes.number("E"), nodes.entries("E")) == ("One", 1, ("One",))
    with pytest.raises(CameraRefused, match="E: 'Two' is not offered: choose among One"):
        nodes.set("E", "Two")
    nodes.set("Switch", True)
    nodes.set("E", "Two")
    assert nodes.entries("E") == ("One", "Two")
    assert nodes.number("E") == 2
    nodes.set("R", 9)
    with pytest.raises(CameraProtocol, match="E: its value 9 has no name"):
        nodes.text("E")


def test_entries_go_by_their_symbolic_names_and_of_one_number_the_available_one_counts() -> None:
    nodes = node_map(
        '<Enumeration Name="E"><EnumEntry Name="E_Old"><pIsAvailable>No</pIsAvailable><Value>2</Value>'
        '</EnumEntry><EnumEntry Name="E_Mono12"><Value>2</Value><Symbolic>Mono12</Symbolic></EnumEntry>'
        '<EnumEntry Name="Mono8"><Value>3</Value></EnumEntry><pValue>R</pValue></Enumeration>'
        '<Integer Name="No"><Value>0</Value></Integer>' + register("IntReg", "<Length>4</Length>")
    )
    assert nodes.entries("E") == ("Mono12", "Mono8")
    nodes.set("E", "Mono12")
    assert (nodes.number("E"), nodes.text("E")) == (2, "Mono12")
    nodes.set("E", "Mono8")
    assert nodes.text("E") == "Mono8"


def test_the_only_entry_of_a_number_has_its_name_though_its_availability_cannot_be_read() -> None:
    nodes = node_map(
        '<Enumeration Name="E"><EnumEntry Name="A"><pIsAvailable>No</pIsAvailable><Value>2</Value>'
        "</EnumEntry><Value>2</Value></Enumeration>"
        '<IntSwissKnife Name="No"><Formula>1 / 0</Formula></IntSwissKnife>'
    )
    assert nodes.text("E") == "A"


def test_booleans_and_commands() -> None:
    memory = Bytes()
    nodes = node_map(
        '<Boolean Name="B"><pValue>R</pValue><OnValue>7</OnValue><OffValue>5</OffValue></Boolean>'
        '<Command Name="C"><pValue>R</pValue><CommandValue>9</CommandValue></Command>'
        + register("IntReg", "<Length>1</Length>"),
        memory,
    )
    nodes.set("B", True)
    assert nodes.number("B") == 1
    nodes.set("B", False)
    assert nodes.number("B") == 0
    assert nodes.done("C")
    nodes.execute("C")
    assert not nodes.done("C")
    memory.data[0x10] = 0
    assert nodes.done("C")
    assert [data for _, data in memory.writes] == [b"\x07", b"\x05", b"\x09"]
    with pytest.raises(CameraProtocol, match="no Command"):
        nodes.execute("B")


CONVERTER = (
    '<Converter Name="K"><pVariable Name="S">Scale</pVariable><Constant Name="HALF">0.5</Constant>'
    '<Expression Name="OFFSET">S * HALF</Expression><FormulaTo>(OFFSET - FROM) * S</FormulaTo>'
    "<FormulaFrom>OFFSET - TO / S</FormulaFrom><pValue>N</pValue></Converter>"
    '<Float Name="Scale"><Value>10.0</Value></Float>'
    '<Integer Name="N"><pValue>R</pValue><Max>100</Max></Integer>' + register("IntReg", "<Length>2</Length>")
)


def test_converters_go_both_ways() -> None:
    nodes = node_map(CONVERTER)
    nodes.set("K", 1.52)
    assert nodes.number("N") == 35  # 34.8, to the nearest.
    assert nodes.number("K") == 1.5
    assert (nodes.limits("K").low, nodes.limits("K").high) == (-5.0, 5.0)
    with pytest.raises(CameraRefused, match="K: 101 is not in 0 to 100"):
        nodes.set("K", -5.1)


@pytest.mark.parametrize(
    ("to", "back"), [("10 ** (FROM / 20)", "20 * LG(TO)"), ("FROM / 6.6667", "TO * 6.6667")]
)
def test_converters_take_their_ends(to: str, back: str) -> None:
    """Through both formulas the end 5 is 5.000000000000001 in the first, as is 188,996 in the second."""
    for end in (5.0, 12.0, 15.0, 188996.0):
        nodes = node_map(
            f'<Converter Name="K"><FormulaTo>{to}</FormulaTo><FormulaFrom>{back}</FormulaFrom>'
            f'<pValue>F</pValue></Converter><Float Name="F"><pValue>R</pValue><Min>1</Min><Max>{end}</Max>'
            "</Float>" + register("FloatReg", "<Length>8</Length>")
        )
        nodes.set_nearest("K", 1e12)
        assert nodes.number("F") == pytest.approx(end, rel=1e-12)
        with pytest.raises(CameraRefused, match=r"K: .* is not in 1 to "):
            nodes.set("K", nodes.limits("K").high * 1.0001)


def test_converters_of_converters_are_set_though_an_end_has_no_value() -> None:
    """LG(0) has none; genicam 1.6.0 sets the register to 2 here too."""
    nodes = node_map(
        '<Converter Name="K"><FormulaTo>FROM</FormulaTo><FormulaFrom>TO</FormulaFrom><pValue>P</pValue>'
        '</Converter><Converter Name="P"><FormulaTo>10 ** (FROM / 20)</FormulaTo>'
        "<FormulaFrom>20 * LG(TO)</FormulaFrom><pValue>R</pValue></Converter>"
        + register("IntReg", "<Length>1</Length>")
    )
    nodes.set("K", 6.0)
    assert nodes.number("R") == 2
    with pytest.raises(CameraRefused, match=r"K: 1000 is not in 0 to 255"):
        nodes.set("K", 60.0)


def test_values_chosen_by_an_index() -> None:
    nodes = node_map(
        '<Integer Name="V"><pIndex>I</pIndex><pValueIndexed Index="1">A</pValueIndexed>'
        "<ValueDefault>5</ValueDefault></Integer>"
        '<Integer Name="I"><Value>1</Value></Integer><Integer Name="A"><Value>77</Value></Integer>'
    )
    assert nodes.number("V") == 77
    nodes.set("I", 2)
    assert nodes.number("V") == 5


def test_access_follows_modes_locks_and_availability() -> None:
    nodes = node_map(
        '<Integer Name="N"><pIsAvailable>There</pIsAvailable><pIsLocked>Lock</pIsLocked><pValue>R</pValue>'
        '</Integer><Integer Name="There"><Value>1</Value></Integer><Integer Name="Lock"><Value>0</Value>'
        '</Integer><Integer Name="Imposed"><ImposedAccessMode>RO</ImposedAccessMode><pValue>R</pValue>'
        "</Integer>" + register("IntReg", "<Length>1</Length>")
    )
    assert nodes.writable("N")
    assert not nodes.writable("Imposed")
    nodes.set("Lock", 1)
    assert not nodes.writable("N")
    with pytest.raises(CameraRefused, match="N: it cannot be set"):
        nodes.set("N", 1)
    assert nodes.number("N") == 0
    nodes.set("There", 0)
    assert not nodes.available("N")
    with pytest.raises(CameraRefused, match="N: it cannot be read"):
        nodes.number("N")
    assert not nodes.available("Nobody")
    with pytest.raises(CameraRefused, match="Nobody: there is no Nobody"):
        nodes.number("Nobody")


@pytest.mark.parametrize("kind", ["Float", "Integer", "Converter"])
def test_a_feature_is_not_there_where_its_register_is_not(kind: str) -> None:
    formulas = "<FormulaTo>FROM</FormulaTo><FormulaFrom>TO</FormulaFrom>" if kind == "Converter" else ""
    nodes = node_map(
        f'<{kind} Name="F">{formulas}<pValue>R</pValue></{kind}><Integer Name="Never"><Value>0</Value>'
        f"</Integer>" + register("IntReg", "<Length>4</Length><pIsImplemented>Never</pIsImplemented>")
    )
    assert not nodes.available("F")
    assert not nodes.writable("F")


def test_a_feature_is_not_there_where_nobody_can_tell() -> None:
    """Its pIsAvailable is in a chunk that does not come."""
    nodes = node_map(
        '<Float Name="F"><pIsAvailable>R</pIsAvailable><Value>1</Value></Float>'
        '<IntReg Name="R"><Address>0</Address><Length>4</Length><AccessMode>RO</AccessMode>'
        "<pPort>Chunk</pPort>"
        '</IntReg><Port Name="Chunk"><ChunkID>1001</ChunkID></Port>'
    )
    assert not nodes.available("F")
    nodes.attach_chunks({0x1001: bytes((1, 0, 0, 0))})
    assert nodes.available("F")
