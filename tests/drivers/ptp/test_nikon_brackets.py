"""Nikon's brackets by the lists that bodies sent, as libgphoto2's dumps have them."""

import pytest

from drivers.ptp.protocol.codec import Value
from drivers.ptp.protocol.codes import DataType, NikonProperty
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm, RangeForm
from drivers.ptp.vendors.nikon_brackets import offered, values

NEW_STEPS = EnumForm((2, 4, 6, 12, 18))
NEW_PROGRAMS = EnumForm((0, 258, 514, 259, 515, 1027, 1029, 1031, 1033))


def described(
    code: int, form: RangeForm | EnumForm, current: Value = 0, *, writable: bool = True
) -> DevicePropDesc:
    return DevicePropDesc(code, DataType.UINT16, writable, current, current, form)


def brackets(
    steps: RangeForm | EnumForm, programs: RangeForm | EnumForm, *, writable: bool = True
) -> set[tuple[int, int]]:
    step = described(NikonProperty.BRACKET_STEP, steps, writable=writable)
    program = described(NikonProperty.BRACKET_PROGRAM, programs, writable=writable)
    return {(one.thirds, one.frames) for one in offered(step, program)}


@pytest.mark.parametrize(
    ("steps", "programs", "thirds", "frames"),
    [
        pytest.param(RangeForm(0, 5, 1), RangeForm(0, 8, 1), {1, 2, 3, 6, 9}, {3, 5, 7, 9}, id="Z 6"),
        pytest.param(NEW_STEPS, NEW_PROGRAMS, {1, 2, 3, 6, 9}, {3, 5, 7, 9}, id="Z 6II"),
        pytest.param(RangeForm(0, 3, 1), RangeForm(0, 7, 1), {1, 2, 3}, {3, 5, 7, 9}, id="D700"),
        pytest.param(RangeForm(0, 5, 1), RangeForm(0, 2, 1), {1, 2, 3, 6, 9}, {3}, id="D600"),
        pytest.param(RangeForm(0, 7, 1), RangeForm(0, 2, 1), {1, 2, 3, 4, 5, 6}, {3}, id="D7000"),
        pytest.param(RangeForm(0, 5, 1), RangeForm(0, 5, 1), {1, 2, 3, 6, 9}, {3, 5}, id="D7100"),
    ],
)
def test_the_lists_of_bodies_are_read(
    steps: RangeForm | EnumForm, programs: RangeForm | EnumForm, thirds: set[int], frames: set[int]
) -> None:
    assert brackets(steps, programs) == {(one, number) for one in thirds for number in frames}


def test_what_cannot_be_set_or_is_not_known_offers_none() -> None:
    assert brackets(RangeForm(0, 5, 1), RangeForm(0, 7, 1), writable=False) == set()  # D850
    assert brackets(RangeForm(0, 6, 1), RangeForm(0, 7, 1)) == set()
    assert brackets(RangeForm(0, 5, 1), RangeForm(0, 3, 1)) == set()


def test_a_program_that_is_the_only_one_need_not_be_set() -> None:
    """Act as a D5100 and a D5500."""
    step = described(NikonProperty.BRACKET_STEP, RangeForm(0, 7, 1))
    for number in (2, 4):
        program = described(
            NikonProperty.BRACKET_PROGRAM, RangeForm(number, number, 1), number, writable=False
        )
        assert {one.frames for one in offered(step, program)} == {3}


def test_a_bracket_knows_what_the_properties_are_set_to() -> None:
    step = described(NikonProperty.BRACKET_STEP, NEW_STEPS)
    program = described(NikonProperty.BRACKET_PROGRAM, NEW_PROGRAMS)
    (wanted,) = [one for one in offered(step, program) if (one.thirds, one.frames) == (6, 5)]
    assert values(wanted) == (12, 0x405)
