"""The properties of a simulated PTP camera: its dials, and the few others that drivers look at."""

from dataclasses import replace

from drivers.errors import CameraProtocol
from drivers.ptp.protocol.codec import Reader, Value
from drivers.ptp.protocol.codes import (
    DataType,
    NikonProperty,
    PropertyCode,
    ResponseCode,
    SonyProperty,
)
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm, RangeForm
from drivers.sim.ptp.profiles import CameraProfile, Style
from drivers.sim.ptp.shooting import Shooting

_MANUAL = 1
_STARTED = "20260101T120000"
"""Constant reading of its clock: a simulation's files are dated by the place of the rig."""
SONY_BRACKETS = {
    **{0x8337: (1, 3), 0x8537: (1, 5), 0x8937: (1, 9), 0x8377: (2, 3), 0x8577: (2, 5), 0x8977: (2, 9)},
    **{0x8311: (3, 3), 0x8511: (3, 5), 0x8911: (3, 9), 0x8321: (6, 3), 0x8521: (6, 5)},
    **{0x8331: (9, 3), 0x8531: (9, 5)},
}
"""Thirds of a stop and frames by drive mode."""
_BIASES = tuple(round(1000 * third / 3) for third in range(-9, 10))


def _fixed(code: int, kind: DataType, value: Value, *values: Value) -> DevicePropDesc:
    """A property; writable if it may have several values."""
    return DevicePropDesc(code, kind, len(values) > 1, value, value, EnumForm(values) if values else None)


def _ranging(code: int, low: int, high: int, value: int) -> DevicePropDesc:
    return DevicePropDesc(code, DataType.UINT8, True, value, value, RangeForm(low, high, 1))


def _others(profile: CameraProfile, focal_length_mm: float) -> tuple[DevicePropDesc, ...]:
    """Return what every profile has besides its dials, and what its maker adds."""
    qualities = (*profile.jpeg_settings, profile.raw_setting, *profile.raw_jpeg_settings)
    quality = profile.raw_jpeg_settings[-1] if profile.jpeg else profile.raw_setting
    standard = (
        DevicePropDesc(PropertyCode.BATTERY_LEVEL, DataType.UINT8, False, 100, 100, RangeForm(0, 100, 1)),
        _fixed(PropertyCode.COMPRESSION_SETTING, DataType.UINT8, quality, *qualities),
        _fixed(PropertyCode.WHITE_BALANCE, DataType.UINT16, 4, 2, 4, 6),
        _fixed(PropertyCode.FOCAL_LENGTH, DataType.UINT32, round(100 * focal_length_mm)),
        _fixed(PropertyCode.FOCUS_MODE, DataType.UINT16, _MANUAL, _MANUAL),
        _fixed(PropertyCode.EXPOSURE_PROGRAM_MODE, DataType.UINT16, _MANUAL, _MANUAL),
        _fixed(PropertyCode.EXPOSURE_BIAS, DataType.INT16, 0, *_BIASES),
        _fixed(PropertyCode.STILL_CAPTURE_MODE, DataType.UINT16, 1, 1, 2),
        DevicePropDesc(PropertyCode.DATE_TIME, DataType.STRING, True, _STARTED, _STARTED),
    )
    if profile.style is Style.NIKON:
        return (
            *standard,
            _fixed(NikonProperty.RECORDING_MEDIA, DataType.UINT8, 0, 0, 1),
            _ranging(NikonProperty.BRACKET_SET, 0, 4, 0),
            _ranging(NikonProperty.MANUAL_BRACKET, 0, 3, 0),
            _ranging(NikonProperty.BRACKET_ENABLE, 0, 1, 0),
            _ranging(NikonProperty.BRACKET_STEP, 0, 5, 3),
            _ranging(NikonProperty.BRACKET_PROGRAM, 0, 8, 8),
            DevicePropDesc(PropertyCode.BURST_NUMBER, DataType.UINT16, True, 1, 1, RangeForm(1, 65535, 1)),
        )
    if profile.style is Style.SONY:
        single = _fixed(PropertyCode.STILL_CAPTURE_MODE, DataType.UINT16, 1, 1, 2, *SONY_BRACKETS)
        return (
            *(one for one in standard if one.code != single.code),
            single,
            _fixed(SonyProperty.SAVE_DESTINATION, DataType.UINT16, 1, 1, 16, 17),
            DevicePropDesc(
                SonyProperty.OBJECT_IN_MEMORY, DataType.UINT16, False, 0, 0, RangeForm(0, 0xFFFF, 1)
            ),
        )
    return standard


def _within(form: RangeForm, value: Value) -> bool:
    numbers = (form.minimum, value, form.maximum)
    low, number, high = (one if isinstance(one, int) else 0 for one in numbers)
    return low <= number <= high


class SimulatedProperties:
    """The properties of one camera by code."""

    def __init__(self, shooting: Shooting) -> None:
        self._shooting = shooting
        optics = shooting.camera.body.optics
        focal_length = optics.sensor_width_mm * optics.lens.fx / optics.lens.width
        self._others = {
            description.code: description for description in _others(shooting.profile, focal_length)
        }

    def codes(self) -> tuple[int, ...]:
        """All, ascending."""
        return tuple(sorted({*self._shooting.dials, *self._others}))

    def description(self, code: int) -> DevicePropDesc | None:
        """Description of a property, or None."""
        dial = self._shooting.dials.get(code)
        if dial is None:
            return self._others.get(code)
        shown = self._shooting.shown(dial)
        return DevicePropDesc(code, dial.data_type, True, shown, shown, EnumForm(dial.numbers()))

    def put(self, code: int, value: Value) -> None:
        """Set a property of the camera's own."""
        self._others[code] = replace(self._others[code], current=value)

    def set(self, code: int, data: bytes) -> ResponseCode:
        """Set a property to the bytes of a value, as the host may; refused while a shot is under way."""
        description = self.description(code)
        if description is None:
            return ResponseCode.DEVICE_PROP_NOT_SUPPORTED
        if not description.writable:
            return ResponseCode.ACCESS_DENIED
        try:
            reader = Reader(data)
            value = reader.value(description.data_type)
        except CameraProtocol:
            return ResponseCode.INVALID_DEVICE_PROP_FORMAT
        if reader.remaining:
            return ResponseCode.INVALID_DEVICE_PROP_FORMAT
        if isinstance(description.form, EnumForm) and value not in description.form.values:
            return ResponseCode.INVALID_DEVICE_PROP_VALUE
        if isinstance(description.form, RangeForm) and not _within(description.form, value):
            return ResponseCode.INVALID_DEVICE_PROP_VALUE
        if self._shooting.shooting:
            return ResponseCode.DEVICE_BUSY
        dial = self._shooting.dials.get(code)
        if dial is None:
            self.put(code, value)
            if code == PropertyCode.COMPRESSION_SETTING:
                self._shooting.quality = value
        else:
            assert isinstance(value, int)
            self._shooting.turn(dial, value)
        return ResponseCode.OK
