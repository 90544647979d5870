"""Random descriptions over random memory: every question ends, with a finite answer or our error."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging.errors import CameraError

from .nodes import Bytes, node_map

NAMES = tuple("ABCDEF")
NUMBERS = st.sampled_from(
    (
        "0",
        "1",
        "2",
        "7",
        "-1",
        "0x10",
        "0xFF",
        "0xFFFFFFFFFFFFFFFF",
        "64",
        "1.5",
        "1e300",
        "nan",
        "inf",
        "-inf",
        "x",
        "",
    )
)
FORMULAS = st.sampled_from(
    (
        "P",
        "P + Q",
        "P + P",
        "P / Q",
        "P &lt;&lt; Q",
        "P ** Q",
        "E0 + E0",
        "1 ? P : Q",
        "EXP(P)",
        "ROUND(P, Q)",
        "((",
        "FROM",
        "TO / P",
    )
)
LITERALS = (
    *("Value", "Min", "Max", "Inc", "Address", "Length", "Bit", "LSB", "MSB", "OnValue", "OffValue"),
    *("CommandValue", "ValueDefault"),
)
REFERENCES = (
    *("pValue", "pMin", "pMax", "pInc", "pAddress", "pLength", "pIndex", "pIsAvailable", "pIsImplemented"),
    *("pIsLocked", "pValueDefault"),
)
KINDS = (
    *("Integer", "Float", "Boolean", "Enumeration", "Command", "String", "IntReg", "MaskedIntReg"),
    *(
        "FloatReg",
        "StringReg",
        "SwissKnife",
        "IntSwissKnife",
        "Converter",
        "IntConverter",
        "Category",
        "Other",
    ),
)
NAME = st.sampled_from(NAMES)
CHILD = st.one_of(
    st.builds("<{0}>{1}</{0}>".format, st.sampled_from(LITERALS), NUMBERS),
    st.builds("<{0}>{1}</{0}>".format, st.sampled_from(REFERENCES), NAME),
    st.builds('<pIndex Offset="{0}">{1}</pIndex>'.format, NUMBERS, NAME),
    st.builds('<pIndex pOffset="{0}">{1}</pIndex>'.format, NAME, NAME),
    st.builds('<ValueIndexed Index="{0}">{1}</ValueIndexed>'.format, NUMBERS, NUMBERS),
    st.builds('<pValueIndexed Index="{0}">{1}</pValueIndexed>'.format, NUMBERS, NAME),
    st.builds('<EnumEntry Name="{0}"><Value>{1}</Value></EnumEntry>'.format, NAME, NUMBERS),
    st.builds("<{0}>{1}</{0}>".format, st.sampled_from(("Formula", "FormulaTo", "FormulaFrom")), FORMULAS),
    st.builds('<pVariable Name="{0}">{1}</pVariable>'.format, st.sampled_from("PQ"), NAME),
    st.builds('<Expression Name="E0">{0}</Expression>'.format, FORMULAS),
    st.builds("<IntSwissKnife><Formula>{0}</Formula></IntSwissKnife>".format, FORMULAS),
    st.sampled_from(
        (
            *("<AccessMode>RW</AccessMode>", "<AccessMode>WO</AccessMode>", "<pPort>Device</pPort>"),
            *("<Endianess>BigEndian</Endianess>", "<Sign>Signed</Sign>"),
        )
    ),
)
NODE = st.tuples(st.sampled_from(KINDS), st.lists(CHILD, max_size=7))
DESCRIPTIONS = st.lists(NODE, min_size=len(NAMES), max_size=len(NAMES)).map(
    lambda nodes: "".join(
        f'<{kind} Name="{name}">{"".join(children)}</{kind}>'
        for name, (kind, children) in zip(NAMES, nodes, strict=True)
    )
)
VALUES = st.one_of(st.integers(-(2**63), 2**63), st.floats(), st.booleans(), st.text(max_size=4))


@settings(max_examples=120)
@given(inside=DESCRIPTIONS, content=st.binary(min_size=256, max_size=256), value=VALUES)
@pytest.mark.timeout(60)
def test_any_description_gives_finite_numbers_or_our_error(
    inside: str, content: bytes, value: int | float | bool | str
) -> None:
    memory = Bytes()
    memory.data[:] = content
    nodes = node_map(inside, memory)

    def ask(question: Callable[[], object]) -> object:
        try:
            return question()
        except CameraError:
            return None

    for name in NAMES:
        number = ask(lambda name=name: nodes.number(name))
        assert number is None or math.isfinite(number)
        for question in (nodes.text, nodes.entries, nodes.limits, nodes.available, nodes.writable):
            ask(lambda name=name, question=question: question(name))
        ask(lambda name=name: nodes.set(name, value))
        ask(lambda name=name: nodes.execute(name))
        ask(lambda name=name: nodes.done(name))
