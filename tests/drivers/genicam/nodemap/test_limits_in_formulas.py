"""Variables of formulas whose names end in .Min, .Max, .Inc or .Entry.NAME: limits, steps and entries."""

import sys

import pytest

from drivers.errors import CameraProtocol

from .nodes import node_map, register

NODES = (
    '<Integer Name="Frame"><pValue>R</pValue><Min>10</Min><Max>1000</Max><Inc>5</Inc></Integer>'
    '<Integer Name="Plain"><Value>3</Value></Integer><Float Name="Endless"><Value>3.0</Value></Float>'
    + '<Enumeration Name="Choice"><EnumEntry Name="E_B"><pIsAvailable>No</pIsAvailable><Value>7</Value>'
    "<Symbolic>B</Symbolic></EnumEntry><EnumEntry Name='Max'><Value>12</Value></EnumEntry><Value>12</Value>"
    '</Enumeration><Integer Name="No"><Value>0</Value></Integer>' + register("IntReg", "<Length>4</Length>")
)
LARGEST = sys.float_info.max


def knife(name: str, of: str, kind: str = "SwissKnife") -> str:
    return f'<{kind} Name="K"><pVariable Name="{name}">{of}</pVariable><Formula>{name}</Formula></{kind}>'


@pytest.mark.parametrize(
    ("name", "of", "value"),
    [
        ("X", "Frame", 500),
        ("X.Value", "Frame", 500),
        ("X.Min", "Frame", 10),
        ("X.Max", "Frame", 1000),
        ("X.Inc", "Frame", 5),
        ("X.Inc", "Plain", 1),
        ("Max", "Frame", 500),
        ("X.Min", "Plain", -(2.0**63)),
        ("X.Max", "Plain", 2.0**63),
        ("X.Min", "Endless", -LARGEST),
        ("X.Max", "Endless", LARGEST),
        ("X.Entry.B", "Choice", 7),
        ("X.Entry.Max", "Choice", 12),
    ],
)
def test_they_are_as_in_genicam(name: str, of: str, value: float) -> None:
    """Numbers of genicam 1.6.0."""
    nodes = node_map(NODES + knife(name, of))
    nodes.set("Frame", 500)
    assert nodes.number("K") == value


@pytest.mark.parametrize(
    ("name", "of", "value"),
    [("X.Min", "Plain", -(2**63)), ("X.Max", "Wide", 2**63 - 1), ("X.Inc", "Endless", 1)],
)
def test_those_of_whole_formulas_have_64_bits(name: str, of: str, value: int) -> None:
    """Numbers of genicam 1.6.0."""
    wide = '<IntReg Name="Wide"><Address>0</Address><Length>8</Length><pPort>Device</pPort></IntReg>'
    assert node_map(NODES + wide + knife(name, of, "IntSwissKnife")).number("K") == value


@pytest.mark.parametrize(
    ("name", "of", "what"),
    [("Inc", "Endless", "Inc"), ("Entry.E_B", "Choice", "entry E_B"), ("Entry.B", "Frame", "entry B")],
)
def test_one_that_is_missing_is_refused(name: str, of: str, what: str) -> None:
    nodes = node_map(NODES + knife(f"X.{name}", of))
    with pytest.raises(CameraProtocol, match=rf"K: a formula needs the {what} of {of}, which has no"):
        nodes.number("K")


def test_they_follow_what_is_set() -> None:
    nodes = node_map(
        NODES
        + knife("X.Max", "Inner")
        + '<Integer Name="Inner"><Value>1</Value><pMax>Frame</pMax></Integer>'
        + '<Float Name="Time"><Value>1.0</Value><pMax>K</pMax></Float>'
    )
    for end in (20, 800):
        nodes.set("Frame", end)
        assert nodes.limits("Time").high == end


def test_chains_of_them_take_no_exponential_time() -> None:
    converters = "".join(
        f'<Converter Name="C{at}"><pVariable Name="A.Max">C{at + 1}</pVariable>'
        f'<pVariable Name="B.Min">C{at + 1}</pVariable><FormulaTo>FROM - A.Max + B.Min</FormulaTo>'
        f"<FormulaFrom>TO + A.Max - B.Min</FormulaFrom><pValue>Frame</pValue></Converter>"
        for at in range(30)
    )
    nodes = node_map(NODES + converters.replace("C30<", "Frame<"))
    assert nodes.limits("C0").high > 0
