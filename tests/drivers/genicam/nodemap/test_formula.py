"""GenICam's formulas: values worked out by hand or asked of the committee's own evaluator; no nonsense."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraProtocol
from drivers.genicam.nodemap.formula import Number, parse

# What `genicam` 1.6.0 (the committee's own) gives; test_judges asks it again where it is installed.
BOTH = {
    "-2**2": 4,
    "2**3**2": 64,
    "~2**2": 9,
    "2*3**2": 18,
    "1=1": 1,
    "1<>2": 1,
    "6&3=3": 0,
    "2&3=2": 1,
    "1|6&3": 3,
    "7^6&3": 1,
    "1|2^3": 0,
    "1<<4+1": 17,
    "1+1<<2": 5,
    "3*5&1": 3,
    "6*1&2": 0,
    "1|1<<1": 2,
    "16>>1**2": 64,
    "3**1|2": 3,
    "2&&2=2": 0,
    "2=2&&2": 1,
    "1||0&&0": 0,
    "5>3>1": 0,
    "2=1<3": 1,
    "0?2:0?4:5": 5,
    "1 ? 2 : 3 + 4": 2,
    "3-2-1": 0,
    "8/2*4": 16,
    "5<<70": 320,
    "-7>>1": -4,
    "-7%3": -1,
    "7 % -3": 1,
    "SGN(-3)": -1,
    "NEG(3)": -3,
    "0x1F&0x0F": 15,
}
WHOLE = {"7/2": 3, "-7/2": -3, "2**-1": 0, "9223372036854775807+1": -(2**63), "7/2*2": 6}
FLOAT = {
    "7/2": 3.5,
    "2**-1": 0.5,
    "7.5%2": 1.5,
    "2.9&3": 2,
    "ROUND(2.567,1)": 2.6,
    "ROUND(-2.5)": -3,
    "ROUND(1234.5,-2)": 1200,
    "LN(E)": 1,
    "LN(E())": 1,
    "PI": math.pi,
    "lg(100)": 2,
    "TRUNC(-2.5)": -2,
    "FLOOR(-1.2)": -2,
    "CEIL(1.2)": 2,
    "ABS(-3)": 3,
    "SQRT(2)": 2**0.5,
    "ASIN(1)+ACOS(1)+ATAN(1)": math.pi * 0.75,
    "SIN(1)*SIN(1)+COS(1)*COS(1)": 1,
    "TAN(0)+EXP(0)": 1,
    "1E-3": 0.001,
    # In 32 bits, the places to shift by counted in 32, too.
    "1<<31": -(2**31),
    "1<<32": 1,
    "1<<33": 2,
    "3<<31": -(2**31),
    "256>>33": 128,
    "2147483647<<1": -2,
    "(0-2147483648)|0": -(2**31),
    "(65535<<16)>>16": -1,
    "(60000<<16)>>16": -5536,
    "(32767<<16)>>16": 32767,
}
SIGN = "(T > 32767 ? (T << 16) >> 16 : T)/10"
"""How a FLIR A35 makes degrees of the 16 bits of its temperatures."""


@pytest.mark.parametrize(("text", "value"), (BOTH | WHOLE).items())
def test_in_whole_numbers(text: str, value: Number) -> None:
    assert parse(text, whole=True)({}) == value


@pytest.mark.parametrize(("text", "value"), (BOTH | FLOAT).items())
def test_in_floats(text: str, value: Number) -> None:
    assert parse(text, whole=False)({}) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(("text", "value"), [("1?2:0?4:5", 2), ("-(1)+2", 1), ("-(2)**2", 4), ("3--1", 4)])
@pytest.mark.parametrize("whole", [False, True])
def test_where_the_committees_evaluator_is_otherwise(text: str, value: int, whole: bool) -> None:
    assert parse(text, whole=whole)({}) == value


def test_variables_are_looked_up_when_used() -> None:
    formula = parse("A = 1 ? GAIN.Value * 2 : MISSING", whole=True)
    assert formula({"A": 1, "GAIN.Value": 21}) == 42
    with pytest.raises(CameraProtocol, match="MISSING"):
        formula({"A": 0})


@pytest.mark.parametrize(
    "text",
    ["", "1+", "(1", "1)", "1 2", "1?2", "FOO(1)", "1$2", "a.b(", "1..2", "__import__('os')", "x=>1", "()"],
)
def test_nonsense_is_refused(text: str) -> None:
    with pytest.raises(CameraProtocol, match="formula"):
        parse(text, whole=False)({"x": 1, "a": 2})


@pytest.mark.parametrize("text", ["1/0", "1%0", "LN(0)", "SQRT(-1)", "EXP(1000)", "10.0**400", "1e308*10"])
def test_what_has_no_value_is_refused(text: str) -> None:
    with pytest.raises(CameraProtocol, match="no value"):
        parse(text, whole=False)({})


@pytest.mark.parametrize("text", ["(" * 5000, "-" * 5000 + "1", "1" + "+1" * 4900, "1?" * 4000])
def test_deep_formulas_end_in_our_error_or_a_value(text: str) -> None:
    with contextlib.suppress(CameraProtocol):
        assert parse(text, whole=True)({}) == 4901


def test_an_integer_formula_takes_no_fractions() -> None:
    with pytest.raises(CameraProtocol, match="no whole number"):
        parse("VALUE * 0.5", whole=True)


@given(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1))
def test_whole_numbers_compute_like_c(a: int, b: int) -> None:
    def value(text: str) -> Number:
        return parse(text, whole=True)({"A": a, "B": b})

    def wrap(number: int) -> int:
        return int.from_bytes((number % 2**64).to_bytes(8, "little"), "little", signed=True)

    assert value("A+B") == wrap(a + b)
    assert value("A*B") == wrap(a * b)
    assert value("(A&B)|(A^B)") == a | b
    assert value("~A") == wrap(~a)
    assert value("A<B ? A : B") == min(a, b)
    if b:
        assert value("A/B*B+A%B") == a
        assert abs(int(value("A%B"))) < abs(b)
        assert value("A%B") == 0 or (value("A%B") < 0) == (a < 0)


@given(st.text(alphabet="0123456789.+-*/%&|^~<>=?:(),ABCENXx eSINROUD", max_size=60), st.booleans())
def test_any_text_gives_a_number_or_our_error(text: str, whole: bool) -> None:
    try:
        value = parse(text, whole=whole)({"A": 3, "B": -5, "C": 0, "X": 2**40})
    except CameraProtocol:
        return
    assert isinstance(value, int if whole else float)


@pytest.mark.parametrize(
    ("code", "degrees"), [(300, 30.0), (32767, 3276.7), (32768, -3276.8), (60000, -553.6), (65535, -0.1)]
)
def test_a_sign_is_extended_by_shifts(code: int, degrees: float) -> None:
    assert parse(SIGN, whole=False)({"T": code}) == pytest.approx(degrees)


def test_beyond_32_bits_bits_are_those_of_64() -> None:
    """The committee's evaluator has no value there."""
    for text, value in {
        "4294967295>>1": 2147483647,
        "4294967295&65535": 65535,
        "2147483648|1": 2147483649,
    }.items():
        assert parse(text, whole=False)({}) == value


@pytest.mark.parametrize(
    ("value", "whole"),
    [(0.4, 0), (0.5, 1), (1.5, 2), (2.5, 3), (-0.4, 0), (-0.5, -1), (-2.5, -3), (-627.74, -628)],
)
def test_a_variable_of_a_formula_in_whole_numbers_is_rounded(value: float, whole: int) -> None:
    assert parse("V", whole=True)({"V": value}) == whole
    assert parse("V + 1", whole=True)({"V": value}) == whole + 1
