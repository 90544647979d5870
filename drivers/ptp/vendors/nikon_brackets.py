"""Brackets that a Nikon shoots by itself, by the range of its properties.

Source: libgphoto2's tables of steps and programs, and the lists of its dumps, as a program for these bodies
(digiCamControl) names their values. Bodies since the D780 and the Z 6II count steps in sixths of a stop and
have the frames in the low byte of a program; those before number both, and each number of steps means others.
"""

from drivers.ptp.autobracket import AutoBracket
from drivers.ptp.protocol.codec import Value
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm, RangeForm

_STEPS = {
    3: {0: 1, 2: 2, 3: 3},
    5: {0: 1, 2: 2, 3: 3, 4: 6, 5: 9},
    7: {0: 1, 2: 2, 3: 3, 4: 4, 6: 5, 7: 6},
}
"""Thirds of a stop by value, by the highest value; what is left out is in halves of a stop."""
_PROGRAMS = {
    2: {2: 3},
    4: {4: 3},
    5: {4: 3, 5: 5},
    7: {4: 3, 5: 5, 6: 7, 7: 9},
    8: {4: 3, 5: 5, 6: 7, 7: 9},
}
"""Frames around the middle one by value, by the highest value."""
_BOTH_SIDES = 0x400
_PROGRAM_BITS = 16


def offered(step: DevicePropDesc, program: DevicePropDesc) -> tuple[AutoBracket, ...]:
    """The brackets that a body has by these two properties; none if they cannot be set, or are not known."""
    form = program.form
    alone = isinstance(form, RangeForm) and form.minimum == form.maximum
    if not step.writable or not (program.writable or alone):
        return ()
    return tuple(
        AutoBracket(number << _PROGRAM_BITS | chosen, thirds, frames)
        for number, thirds in _thirds(step).items()
        for chosen, frames in _frames(program).items()
    )


def values(bracket: AutoBracket) -> tuple[int, int]:
    """Return what step and program are set to for a bracket."""
    return bracket.code >> _PROGRAM_BITS, bracket.code & (1 << _PROGRAM_BITS) - 1


def _thirds(step: DevicePropDesc) -> dict[int, int]:
    if isinstance(step.form, EnumForm):
        return {sixths: sixths // 2 for sixths in _numbers(step.form.values) if sixths and sixths % 2 == 0}
    return _numbered(step.form, _STEPS)


def _frames(program: DevicePropDesc) -> dict[int, int]:
    if isinstance(program.form, EnumForm):
        return {number: number & 0xFF for number in _numbers(program.form.values) if number & _BOTH_SIDES}
    return _numbered(program.form, _PROGRAMS)


def _numbered(form: RangeForm | None, tables: dict[int, dict[int, int]]) -> dict[int, int]:
    if form is None or not isinstance(form.minimum, int) or not isinstance(form.maximum, int):
        return {}
    table = tables.get(form.maximum, {})
    return {number: means for number, means in table.items() if number >= form.minimum}


def _numbers(listed: tuple[Value, ...]) -> list[int]:
    return [value for value in listed if isinstance(value, int)]
