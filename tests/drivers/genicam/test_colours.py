"""Every colour of a mosaic is amplified alike, or the camera is refused."""

from collections.abc import Mapping

import pytest

from drivers.errors import CameraRefused
from drivers.genicam.colours import even_out

from .nodemap.nodes import Bytes, node_map
from .test_processing import LOCKED, amount, choice, switch

RGB = ("Red", "Green", "Blue")


def by_entry(name: str, selector: str, kind: str = "Integer", more: str = "") -> str:
    """An amount with a register for each entry of its selector; a Float counts in thousandths."""
    inside = (
        f"<pValue>{name}Reg</pValue>"
        if kind == "Integer"
        else "<FormulaTo>FROM * 1000</FormulaTo><FormulaFrom>TO / 1000</FormulaFrom>"
        f"<pValue>{name}Reg</pValue>"
    )
    tag = "Converter" if kind == "Float" else kind
    return (
        f'<{tag} Name="{name}">{more}{inside}</{tag}>'
        f'<IntReg Name="{name}Reg"><Address>0</Address><pIndex Offset="4">{selector}</pIndex>'
        "<Length>4</Length><AccessMode>RW</AccessMode><pPort>Device</pPort></IntReg>"
    )


def entries(inside: str, values: tuple[int, ...], name: str, selector: str) -> Mapping[str, float]:
    """Read back each entry after the registers were evened out."""
    memory = Bytes()
    for index, value in enumerate(values):
        memory.data[4 * index : 4 * index + 4] = value.to_bytes(4, "little")
    nodes = node_map(inside, memory)
    even_out(nodes, "cam0")
    read_back = {}
    for entry in nodes.entries(selector):
        nodes.set(selector, entry)
        read_back[entry] = float(nodes.number(name))
    return read_back


def refused(inside: str, values: tuple[int, ...] = ()) -> str:
    with pytest.raises(CameraRefused, match=r"^cam0 changes every frame by its white balance") as caught:
        entries(inside, values, "", "")
    return str(caught.value)


@pytest.mark.parametrize("name", ["BalanceRatio", "BalanceRatioAbs"])
def test_a_factor_becomes_1(name: str) -> None:
    """Red is at 1.6, blue at 1.3."""
    inside = choice("BalanceRatioSelector", 0, *RGB) + by_entry(name, "BalanceRatioSelector", "Float")
    assert entries(inside, (1600, 1000, 1300), name, "BalanceRatioSelector") == dict.fromkeys(RGB, 1.0)


@pytest.mark.parametrize("name", ["BalanceRatio", "BalanceRatioRaw"])
@pytest.mark.parametrize("neutral", [64, 1024])
def test_whole_numbers_become_those_of_green(name: str, neutral: int) -> None:
    inside = choice("BalanceRatioSelector", 0, *RGB) + by_entry(name, "BalanceRatioSelector")
    values = entries(inside, (2 * neutral, neutral, 3 * neutral), name, "BalanceRatioSelector")
    assert values == dict.fromkeys(RGB, neutral)


def test_a_factor_is_set_rather_than_a_whole_number_of_the_same_register() -> None:
    """Use Basler's cameras of the ace series."""
    inside = (
        choice("BalanceRatioSelector", 0, "Red", "Blue")
        + by_entry("BalanceRatioRaw", "BalanceRatioSelector")
        + '<Converter Name="BalanceRatioAbs"><FormulaTo>FROM * 64</FormulaTo><FormulaFrom>TO / 64.0'
        "</FormulaFrom><pValue>BalanceRatioRaw</pValue></Converter>"
    )
    values = entries(inside, (100, 83), "BalanceRatioRaw", "BalanceRatioSelector")
    assert values == {"Red": 64, "Blue": 64}


def test_a_percentage_becomes_100() -> None:
    inside = choice("BalanceRatioSelector", 0, "Red", "Blue") + by_entry(
        "BalanceRatio", "BalanceRatioSelector", more="<Unit>%</Unit>"
    )
    values = entries(inside, (160, 130), "BalanceRatio", "BalanceRatioSelector")
    assert values == {"Red": 100, "Blue": 100}


def test_whole_numbers_without_green_are_in_a_unit_that_nothing_tells() -> None:
    pair = choice("BalanceRatioSelector", 0, "Red", "Blue")
    said = refused(pair + by_entry("BalanceRatioRaw", "BalanceRatioSelector"), (512, 512))
    assert "(BalanceRatioRaw is 512, in a unit of its own): switch it off by its maker's program" in said
    assert "BalanceRatio is 1600" in refused('<Integer Name="BalanceRatio"><Value>1600</Value></Integer>')


@pytest.mark.parametrize("switched", ["BalanceWhiteEnable", "BalanceRatioEnable"])
def test_a_white_balance_that_is_off_may_be_in_any_unit(switched: str) -> None:
    nodes = node_map(switch(switched, 0) + '<Integer Name="BalanceRatio"><Value>1600</Value></Integer>')
    even_out(nodes, "cam0")
    assert nodes.number("BalanceRatio") == 1600


def test_what_cannot_be_set_is_a_refusal() -> None:
    assert "(BalanceRatioAbs is 1.6, where 1 does nothing)" in refused(amount("BalanceRatioAbs", 1.6, LOCKED))
    locked = choice("BalanceRatioSelector", 0, *RGB) + by_entry(
        "BalanceRatio", "BalanceRatioSelector", more=LOCKED
    )
    said = refused(locked, (2048, 1024, 1024))
    assert "BalanceRatioSelector Red: BalanceRatio is 2048, where 1024 does nothing" in said


def test_gains_by_colour_become_alike_and_the_selector_stays() -> None:
    """In dB all are 0; where no unit is stated they are as green is."""
    names = ("All", "DigitalRed", "DigitalGreen", "DigitalBlue")
    for unit, goal in (("<Unit>dB</Unit>", 0.0), ("", 2.0)):
        inside = choice("GainSelector", 0, *names) + by_entry("Gain", "GainSelector", "Float", unit)
        values = entries(inside, (3000, 4500, 2000, 6000), "Gain", "GainSelector")
        assert values == {"All": 3.0, **dict.fromkeys(names[1:], goal)}
    nodes = node_map(choice("GainSelector", 0, *names) + by_entry("Gain", "GainSelector", "Float"))
    even_out(nodes, "cam0")
    assert nodes.text("GainSelector") == "All"


def test_two_greens_and_their_neighbours_are_colours_of_their_own() -> None:
    names = ("Red", "GreenRed", "GreenBlue", "Blue")
    inside = choice("GainSelector", 0, *names) + by_entry("Gain", "GainSelector", "Float")
    values = entries(inside, (1600, 1200, 1100, 1900), "Gain", "GainSelector")
    assert values == dict.fromkeys(names, 1.2)


def test_a_gain_of_one_colour_that_stays_is_a_refusal() -> None:
    inside = choice("GainSelector", 0, "All", *RGB) + by_entry("Gain", "GainSelector", "Float", LOCKED)
    said = refused(inside, (1000, 1600, 1000, 1000))
    assert "(GainSelector Red: Gain is 1.6, where Green is 1)" in said
