"""Sony Alpha: the SDIO handshake, all properties in one blob, pictures through the camera's memory.

Source: libgphoto2's codes and layout of the property blob; what an A7 IV sent (its dumps). Verified
against: the simulated cameras, which follow the same notes; no hardware. Protocol version 2 (200) alone is
spoken. Left out: bodies that take shutter speed only in steps, protocol 3 and its own properties, bulb.
"""

from collections.abc import Generator

from drivers.errors import CameraBusy, CameraLost, CameraProtocol, CameraRefused, CameraTimeout
from drivers.ptp.autobracket import AutoBracket
from drivers.ptp.exposure import SONY_ISO, SONY_TIME, STANDARD_F_NUMBER, Dial
from drivers.ptp.picture import has_raw
from drivers.ptp.protocol.codec import Reader, Value, damaged, pack_value
from drivers.ptp.protocol.codes import (
    UNKNOWN_LENGTH,
    DataType,
    Operation,
    PropertyCode,
    ResponseCode,
    SonyOperation,
    SonyProperty,
)
from drivers.ptp.protocol.datasets import DevicePropDesc, EnumForm, RangeForm
from drivers.ptp.protocol.refusals import RefusedWith
from drivers.ptp.protocol.session import (
    PATIENCE,
    PROMPT_TIMEOUT,
    QUICK_TIMEOUT,
    READY_TIMEOUT,
    Download,
)
from drivers.ptp.vendors.standard import StandardBody
from drivers.ptp.waiting import LATE, deadline
from imaging.errors import CameraError

MEMORY_HANDLE = 0xFFFFC001
"""Handle of the picture that is next to be read."""
READY = 0x8000
"""ObjectInMemory at and above which that picture may be read; reading earlier crashes the firmware."""
VERSION = 0x00C8
_RAW, _RAW_AND_JPEG = 0x10, range(0x11, 0x15)
_UP, _DOWN = 1, 2
_HOST = 1
_START_UP, _PAUSE = 8.0, 0.05
"""Start-up time and polling pause, seconds; its memory is polled, whether or not an event announces a
picture.
"""
_SINGLE = 1
_BRACKETS = {
    code: AutoBracket(code, thirds, frames)
    for thirds, low, most in ((1, 0x37, 9), (2, 0x77, 9), (3, 0x11, 9), (6, 0x21, 5), (9, 0x31, 5))
    for frames in (3, 5, 9)
    if frames <= most
    for code in (0x8000 | frames << 8 | low,)
}
"""StillCaptureMode of continuous brackets: 0x8537 is 5 frames a third of a stop apart."""
_READ_BACKS = 5
_MOST_SECOND_LIST = 0x200
"""A second list of values begins with its length, and the next property with its code, which is greater."""


def unpack_properties(data: bytes) -> dict[int, DevicePropDesc]:
    """The blob of GetAllExtDevicePropInfo by property code; CameraProtocol."""
    reader = Reader(data)
    reader.u64()  # count and padding; bodies send more or fewer than they say
    properties = {}
    while reader.remaining:
        description = _unpack_property(reader)
        properties[description.code] = description
    return properties


def _unpack_property(reader: Reader) -> DevicePropDesc:
    code, number = reader.u16(), reader.u16()
    if number not in DataType.__members__.values():
        raise damaged(f"a property of the unknown data type 0x{number:04X}")
    kind = DataType(number)
    settable, enabled = reader.u8(), reader.u8()
    default, current = reader.value(kind), reader.value(kind)
    shape = reader.u8()
    form: RangeForm | EnumForm | None = None
    if shape == 1:
        form = RangeForm(reader.value(kind), reader.value(kind), reader.value(kind))
    elif shape == 2:
        form = EnumForm(tuple(reader.value(kind) for _ in range(reader.u16())))
        if reader.remaining >= 2 and reader.peek_u16() < _MOST_SECOND_LIST:
            # Newer bodies append what may be set now.
            form = EnumForm(tuple(reader.value(kind) for _ in range(reader.u16())))
    return DevicePropDesc(code, kind, settable == 1 and enabled == 1, default, current, form)


class SonyBody(StandardBody):
    """An Alpha in PC Remote mode."""

    releases = (SonyOperation.SDIO_CONNECT,)
    _files = 1
    """Number of files of a shot: two on a body that is set to RAW+JPEG."""

    knows_make = True
    remembers = False

    def enter(self) -> None:
        """The handshake, RAW as the format and the host as the destination, as far as they can be set.

        A body that is set to RAW+JPEG stays so.
        """
        self.session.has_mode = True
        for phase in (1, 2):
            self.session.get(SonyOperation.SDIO_CONNECT, phase, 0, 0)
        try:
            self.session.get(SonyOperation.GET_EXT_DEVICE_INFO, VERSION, 1)
        except RefusedWith as error:
            raise CameraRefused(
                f"{self.session.where} does not support version {VERSION / 100:g} of Sony's protocol, the "
                "only one of rig's own driver: set USB Connection to PC Remote, or install libgphoto2 "
                "(pip install -e '.[gphoto2]'), which supports more."
            ) from error
        self.session.get(SonyOperation.SDIO_CONNECT, 3, 0, 0)
        listed = self._after_start_up()
        quality = listed.get(PropertyCode.COMPRESSION_SETTING)
        if quality is not None and quality.current in _RAW_AND_JPEG:
            self._files = 2
        else:
            self._choose(quality, _RAW)
        self._choose(listed.get(SonyProperty.SAVE_DESTINATION), _HOST)
        mode = listed.get(PropertyCode.STILL_CAPTURE_MODE)
        if mode is not None and mode.current in _BRACKETS:  # a bracket that broke off left it so
            self._choose(mode, _SINGLE)
        self.time, self.iso = Dial(self, *SONY_TIME), Dial(self, *SONY_ISO)
        self.f_number = Dial(self, *STANDARD_F_NUMBER) if PropertyCode.F_NUMBER in listed else None

    def delivers_raw(self) -> bool:
        """All that are meant here do."""
        return True

    def describe(self, code: int) -> DevicePropDesc:
        """A property out of the blob; CameraRefused if it is not in it."""
        description = self._everything().get(code)
        if description is None:
            raise CameraRefused(
                f"{self.session.where} does not report property 0x{code:04X}: turn its mode dial to M."
            )
        return description

    def write(self, code: int, value: Value) -> None:
        """Set a property to a value."""
        kind = self.describe(code).data_type
        try:
            data = pack_value(kind, value)
        except ValueError as error:
            raise CameraRefused(
                f"{self.session.where} has no value {value!r} of property 0x{code:04X}."
            ) from error
        self.session.run(SonyOperation.SET_CONTROL_A, code, data=data, repeatable=True)

    def wait_ready(self) -> None:
        """Read and throw away pictures of earlier shots: they would come first."""
        super().wait_ready()
        end = self.session.clock.now() + PATIENCE
        while self._in_memory() >= READY:
            if self.session.clock.now() >= end:
                raise CameraBusy(f"{self.session.where} keeps old pictures in memory: switch it off and on.")
            self.discard(Download(MEMORY_HANDLE, self.session.object_info(MEMORY_HANDLE), bytearray()))

    def recount(self) -> None:
        """Do nothing: `wait_ready` removes what failed shots left."""

    def release(self, patience: float = PATIENCE) -> None:
        """Half and full press, and up again; but for the full press, all may be asked for twice."""
        try:
            self._press(SonyProperty.HALF_PRESS, _DOWN, patience)
            self._press(SonyProperty.FULL_PRESS, _DOWN, patience, repeatable=False)
        finally:
            for button in (SonyProperty.FULL_PRESS, SonyProperty.HALF_PRESS):
                self._press(button, _UP, patience)

    def wait(self, exposure: float) -> list[Download]:
        """Wait until a picture lies in its memory; of two, the first is read to see the second."""
        clock = self.session.clock
        end = clock.now() + deadline(exposure)
        clock.sleep(exposure)  # a query meanwhile returns nothing
        files, news = list[Download](), clock.now()
        while clock.now() < end:
            try:
                if self._in_memory() >= READY:
                    file = Download(MEMORY_HANDLE, self.session.object_info(MEMORY_HANDLE), bytearray())
                    if self._files > 1:
                        self.fetch(file)
                    files.append(file)
                    news = clock.now()
            except CameraLost:
                raise
            except CameraError:
                if not has_raw(files):  # else the exposure is here: a JPEG is not worth a shot
                    raise
                return files
            if len(files) == self._files or (has_raw(files) and clock.now() - news >= LATE):
                return files
            self.session.events(_PAUSE)
        raise CameraTimeout(f"{self.session.where} delivered no picture: check its focus and mode dial.")

    def auto_brackets(self) -> tuple[AutoBracket, ...]:
        """Brackets in its list of drive modes; empty for RAW+JPEG, whose files could not be assigned."""
        mode = self._everything().get(PropertyCode.STILL_CAPTURE_MODE)
        if self._files > 1 or mode is None or not mode.writable or not isinstance(mode.form, EnumForm):
            return ()
        return tuple(
            _BRACKETS[value] for value in mode.form.values if isinstance(value, int) and value in _BRACKETS
        )

    def set_auto_bracket(self, bracket: AutoBracket | None) -> None:
        """Select the drive mode; a body whose mode dial is set otherwise keeps that one."""
        wanted = _SINGLE if bracket is None else bracket.code
        self.write(PropertyCode.STILL_CAPTURE_MODE, wanted)
        for _ in range(_READ_BACKS):
            if self.describe(PropertyCode.STILL_CAPTURE_MODE).current == wanted:
                return
            self.session.clock.sleep(_PAUSE)
        raise CameraRefused(f"{self.session.where} keeps its drive mode: free its dial for computers.")

    def shoot_bracket(self, bracket: AutoBracket, seconds: float) -> Generator[Download, None, None]:
        """The button is held down until all frames are there."""
        clock = self.session.clock
        end = clock.now() + deadline(seconds)
        try:
            self._press(SonyProperty.HALF_PRESS, _DOWN, PATIENCE)
            self._press(SonyProperty.FULL_PRESS, _DOWN, PATIENCE, repeatable=False)
            for _ in range(bracket.frames):
                while self._in_memory() < READY:
                    if clock.now() >= end:
                        raise CameraTimeout(f"{self.session.where} broke its bracket off: check its card.")
                    self.session.events(_PAUSE)
                yield Download(MEMORY_HANDLE, self.session.object_info(MEMORY_HANDLE), bytearray())
        finally:
            for button in (SonyProperty.FULL_PRESS, SonyProperty.HALF_PRESS):
                self._press(button, _UP, PATIENCE)

    def handles_of(self, file: Download) -> tuple[int, ...]:
        """Handle of its memory while a picture is there; its objects are never listed.

        Bodies before 2020 hang for good when they are asked to list them (libgphoto2, commit 10870c84).
        """
        return (MEMORY_HANDLE,) if self._in_memory() >= READY else ()

    def fetch(self, file: Download) -> bytes:
        """Fetch in one go, which also frees the memory."""
        if file.data:
            return bytes(file.data)
        most = 1 << 32 if file.info.size == UNKNOWN_LENGTH else max(file.info.size, 1)
        file.data[:] = self.session.get(
            Operation.GET_OBJECT, file.handle, timeout=READY_TIMEOUT, most=most, prompt=PROMPT_TIMEOUT
        )
        return bytes(file.data)

    def discard(self, file: Download) -> None:
        """Reading is what frees the memory."""
        if not file.data:
            self.fetch(file)

    def _everything(self) -> dict[int, DevicePropDesc]:
        try:
            blob = self.session.get(SonyOperation.GET_ALL_EXT_DEVICE_PROP_INFO, timeout=QUICK_TIMEOUT)
        except RefusedWith as error:
            if self.time is None or error.code != ResponseCode.ACCESS_DENIED:
                raise
            # It has begun anew by itself, and wants the handshake again.
            raise CameraLost(f"{self.session.where} has restarted: check its battery and cable.") from error
        return unpack_properties(blob)

    def _choose(self, description: DevicePropDesc | None, wanted: int) -> None:
        """Set a property, if the body has it, lets it be set and lists the value."""
        offered = (
            description.form.values
            if description is not None and isinstance(description.form, EnumForm)
            else ()
        )
        if (
            description is not None
            and wanted in offered
            and description.writable
            and description.current != wanted
        ):
            self.write(description.code, wanted)

    def _in_memory(self) -> int:
        value = self.describe(SonyProperty.OBJECT_IN_MEMORY).current
        if not isinstance(value, int):
            raise CameraProtocol(f"{self.session.where} counts its pictures in words: switch it off and on.")
        return value

    def _after_start_up(self) -> dict[int, DevicePropDesc]:
        """All properties, once the body lists its shutter speed: several need about 3 s to begin."""
        clock = self.session.clock
        end = clock.now() + _START_UP
        while True:
            listed = self._everything()
            if SonyProperty.SHUTTER_SPEED in listed:
                return listed
            if clock.now() >= end:
                raise CameraRefused(
                    f"{self.session.where} lists no shutter speed: set USB to PC Remote, the dial to M."
                )
            clock.sleep(0.2)

    def _press(self, button: int, value: int, patience: float, *, repeatable: bool = True) -> None:
        data = pack_value(DataType.UINT16, value)
        self.session.run(
            SonyOperation.SET_CONTROL_B,
            button,
            data=data,
            timeout=READY_TIMEOUT,
            patience=patience,
            repeatable=repeatable,
        )
