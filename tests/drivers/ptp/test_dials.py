"""Exposure settings against the lists that real bodies sent, and the makers' own bytes."""

import struct
from collections.abc import Iterable

import pytest

from drivers.errors import CameraProtocol, CameraRefused
from drivers.ptp import exposure, shutter
from drivers.ptp.exposure import Dial
from drivers.ptp.protocol.codec import Event, Value
from drivers.ptp.protocol.codes import DataType
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm, RangeForm
from drivers.ptp.shutter import Coding
from drivers.ptp.vendors import nikon, sony

# What a Nikon D780 listed (data/ptp/nikon-d780.txt).
D780_TICKS = (
    *(1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 31, 40, 50, 62, 80, 100, 125, 166, 200, 250, 333, 400, 500),
    *(666, 769, 1000, 1250, 1666, 2000, 2500, 3333, 4000, 5000, 6250, 7692, 10000, 13000, 16000, 20000),
    *(25000, 30000, 40000, 50000, 60000, 80000, 100000, 130000, 150000, 200000, 250000, 300000),
)
D780_QUOTIENTS = (73536, 71936, 70536, 69536, 66036, 65541, 655385, 65537, 851978, 1966081, 4294967294)
D780_SPEEDS = (1 / 8000, 1 / 6400, 1 / 5000, 1 / 4000, 1 / 500, 1 / 5, 10 / 25, 1, 1.3, 30)
# And a Sony A7 IV (data/ptp/sony-a7m4.txt).
A7_RANGE, A7_CURRENT = RangeForm(73536, 1966081, 1), 327690


class Body:
    """One property."""

    def __init__(
        self, values: Iterable[int] | RangeForm, current: int, *, writable: bool = True, deaf: int = 0
    ) -> None:
        self.form = values if isinstance(values, RangeForm) else EnumForm(tuple(values))
        self.current, self.writable, self.deaf, self.writes = current, writable, deaf, 0

    def describe(self, code: int) -> DevicePropDesc:
        return DevicePropDesc(code, DataType.UINT32, self.writable, 0, self.current, self.form)

    def write(self, code: int, value: Value) -> None:
        self.writes += 1
        if self.writes > self.deaf:
            assert isinstance(value, int)
            self.current = value


def dial(body: Body, coding: Coding) -> Dial:
    return Dial(body, 0x500D, coding)


def test_a_real_list_of_ticks_is_read_as_the_dial() -> None:
    choices = dial(Body(D780_TICKS, 400), shutter.TICKS).choices()
    assert len(choices) == len(D780_TICKS)
    assert [choice.code for choice in choices if not choice.certain] == [1, 2]
    true = {1: 1 / 8000, 3: 1 / 3200, 6: 1 / 1600, 15: 1 / 640, 62: 1 / 160, 166: 1 / 60, 333: 1 / 30}
    true |= {769: 1 / 13, 3333: 1 / 3, 6250: 0.625, 13000: 1.3, 300000: 30.0}
    assert {choice.code: choice.value for choice in choices if choice.code in true} == pytest.approx(true)


@pytest.mark.parametrize("wanted", [float(time) for time in shutter.THIRD_STOPS])
def test_every_time_of_the_dial_finds_its_tick(wanted: float) -> None:
    body = Body(D780_TICKS, 400)
    got = dial(body, shutter.TICKS).set(wanted, lambda seconds: None)
    assert exposure.apart(got.value, wanted) < 1 / 6
    assert got.code in (int(wanted * 10000 + 1e-6), round(wanted * 10000)) or wanted >= 0.3
    assert got.certain == (wanted > 1 / 3999)


def test_what_a_file_tells_of_a_tick_is_kept() -> None:
    one = dial(Body(D780_TICKS, 400), shutter.TICKS)
    choice = one.set(1 / 4000, lambda seconds: None)
    assert (choice.code, choice.value, choice.certain) == (2, 1 / 4000, False)
    one.learn(choice, 1 / 30)  # a frame of another exposure teaches nothing
    assert not one.set(1 / 4000, lambda seconds: None).certain
    one.learn(choice, 1 / 4032)
    assert one.set(1 / 4000, lambda seconds: None) == exposure.DialChoice(2, 1 / 4000)


def test_quotients_are_exact_and_bulb_is_none() -> None:
    choices = dial(Body(D780_QUOTIENTS, 65561), shutter.QUOTIENT).choices()
    assert [choice.value for choice in choices] == pytest.approx(D780_SPEEDS)
    for bulb in (0, 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD, 5, 5 << 16):
        assert shutter.QUOTIENT.decode(bulb) is None


def test_a_range_of_quotients_is_filled_from_the_dial() -> None:
    one = dial(body := Body(A7_RANGE, A7_CURRENT), shutter.SONY_QUOTIENT)
    assert len(one.choices()) == len(shutter.THIRD_STOPS)
    assert one.set(0.4, lambda seconds: None).code == 4 << 16 | 10
    assert one.set(1 / 8000, lambda seconds: None).code == body.current == 73536
    assert one.set(100.0, lambda seconds: None).code == 1966081
    assert dial(
        Body(RangeForm(1 << 16 | 1000, 1 << 16 | 1, 1), 1 << 16 | 1), shutter.SONY_QUOTIENT
    ).choices()[0].value == pytest.approx(1 / 1000)


def test_canons_codes_are_the_known_ones() -> None:
    times = {0x10: 30.0, 0x38: 1.0, 0x70: 1 / 125, 0xA0: 1 / 8000, 0x75: 1 / 200, 0x34: 1.5}
    assert {code: float(shutter.CANON_TIMES[code]) for code in times} == pytest.approx(times)
    # Each code is an eighth of a stop, from which the names on the dials stray a little.
    for code, time in shutter.CANON_TIMES.items():
        assert exposure.apart(float(time), 2 ** ((0x38 - code) / 8)) < 0.3
    for code, number in exposure.CANON_F_NUMBERS.items():
        assert exposure.apart(number, 2 ** ((code - 8) / 16)) < 0.1
    for code, iso in exposure.CANON_ISOS.items():
        assert exposure.apart(iso, 100 * 2 ** ((code - 0x48) / 8)) < 0.1
    # What the EOS 6D of the dump listed, 0 being automatic.
    listed = [0, 0x40, *(base + third for base in range(0x48, 0x88, 8) for third in (0, 3, 5)), 0x88]
    isos = [exposure.CANON_ISO.decode(code) for code in listed]
    assert isos[:4] == [None, 50, 100, 125]
    assert isos[-1] == 25600
    assert None not in isos[1:]


def test_automatic_and_read_only_settings() -> None:
    assert exposure.PLAIN_ISO.decode(0xFFFF) is None
    assert exposure.PLAIN_ISO.decode(-1) is None
    assert exposure.LONG_ISO.decode(0xFFFFFF) is None
    fixed = dial(body := Body(D780_TICKS, 400, writable=False), shutter.TICKS)
    assert [choice.code for choice in fixed.choices()] == [400]
    assert fixed.set(1.0, lambda seconds: None).code == 400
    assert body.writes == 0
    with pytest.raises(CameraRefused, match="manual exposure"):
        dial(Body((0xFFFFFFFF,), 0xFFFFFFFF), shutter.TICKS).set(1.0, lambda seconds: None)


def test_a_setting_that_a_busy_body_drops_is_written_again() -> None:
    body = Body(D780_TICKS, 400, deaf=1)
    assert dial(body, shutter.TICKS).set(1.0, lambda seconds: None).code == 10000
    assert body.writes == 2
    stubborn = Body(D780_TICKS, 400, deaf=9)
    assert dial(stubborn, shutter.TICKS).set(1.0, lambda seconds: None).code == 400
    assert stubborn.writes == 2


def test_nikons_events() -> None:
    data = struct.pack("<HHIHI", 2, 0xC101, 0xFFFF0001, 0xC102, 0)
    assert nikon.unpack_events(data) == [Event(0xC101, 0, (0xFFFF0001,)), Event(0xC102, 0, (0,))]
    assert nikon.unpack_events(b"\0\0") == []
    with pytest.raises(CameraProtocol, match="2 events in 6 bytes"):
        nikon.unpack_events(data[:8])


def test_sonys_blob_with_one_list_and_with_two() -> None:
    one = struct.pack("<HHBBHHBHHH", 0x5007, 4, 1, 1, 0, 800, 2, 2, 560, 800)
    two = struct.pack("<HHBBHHBHHHHH", 0xD222, 4, 1, 2, 0, 1, 2, 2, 1, 16, 1, 16)
    three = struct.pack("<HHBBHHBHHH", 0xD215, 4, 0, 1, 0, 0x8001, 1, 0, 0xFFFF, 1)
    properties = sony.unpack_properties(struct.pack("<II", 3, 0) + one + two + three)
    assert properties[0x5007] == DevicePropDesc(0x5007, DataType.UINT16, True, 0, 800, EnumForm((560, 800)))
    assert properties[0xD222] == DevicePropDesc(0xD222, DataType.UINT16, False, 0, 1, EnumForm((16,)))
    assert properties[0xD215].current == 0x8001
    with pytest.raises(CameraProtocol):
        sony.unpack_properties(struct.pack("<II", 3, 0) + one + two[:-1])
