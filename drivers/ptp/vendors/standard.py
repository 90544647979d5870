"""A body that speaks plain PTP: pictures go to its card and stay there.

Verified against: the simulated cameras and the tests' responder; no hardware. The setting that makes a body
write RAW is not part of the standard: choose it in the camera's menu. Of Fuji, only the unit of the exposure
time is known (libgphoto2's dump of an X-T4): what puts those bodies under remote control is left out, and
they are left to libgphoto2.
"""

from collections.abc import Generator

from drivers.errors import CameraRefused
from drivers.ptp.autobracket import AutoBracket
from drivers.ptp.exposure import FUJI_TIME, STANDARD_F_NUMBER, STANDARD_ISO, STANDARD_TIME, Dial
from drivers.ptp.protocol.codec import Value
from drivers.ptp.protocol.codes import FormatCode, Operation, PropertyCode, VendorId
from drivers.ptp.protocol.datasets import DevicePropDesc
from drivers.ptp.protocol.session import PATIENCE, Download, PtpSession
from drivers.ptp.shutter import Coding
from drivers.ptp.waiting import drain, wait_for_objects

NO_BRACKET = "this body has no brackets that can be set remotely: set and trigger each exposure."

_RAW_FORMATS = {FormatCode.DNG, FormatCode.VENDOR_RAW_1, FormatCode.VENDOR_RAW_2, FormatCode.CANON_CR3}


class StandardBody:
    """Setting, releasing and downloading on a camera. The makers' bodies override what they do
    differently.
    """

    verified = "simulated cameras"
    """Hardware that it was verified on, for `rig cameras`."""
    releases: tuple[int, ...] = (Operation.INITIATE_CAPTURE,)
    """The operations that expose; a body that lists none of them cannot be triggered."""

    def __init__(self, session: PtpSession) -> None:
        self.session = session
        self.earlier: set[int] = set()
        """Handles of objects that are not of the next shot."""
        self.standing: AutoBracket | None = None
        """Bracket of the next release, as `bracket_shot.stand` set it; None: a single frame."""
        self.listed: tuple[int, ...] = session.info.properties
        self.time: Dial | None = None
        self.f_number: Dial | None = None
        self.iso: Dial | None = None

    def enter(self) -> None:
        """Take control: remote mode, RAW to the host, the dials; called once, when the session is open."""
        self.earlier.update(self.session.handles())
        self.time = self._dial(FUJI_TIME if self._is_fuji() else STANDARD_TIME)
        self.f_number, self.iso = self._dial(STANDARD_F_NUMBER), self._dial(STANDARD_ISO)

    def leave(self) -> None:
        """Return control to the photographer at the camera."""

    def delivers_raw(self) -> bool:
        """Return whether it can write files that are RAW."""
        info = self.session.info
        return bool(_RAW_FORMATS & {*info.capture_formats, *info.image_formats})

    def obstacle(self) -> str:
        """Return why it cannot shoot for rig, as half a sentence; empty where it can."""
        if not any(self.session.supports(operation) for operation in self.releases):
            return "it takes no pictures on command"
        if self._is_fuji():
            return "its make needs a handshake that only libgphoto2 supports: pip install -e '.[gphoto2]'"
        return "" if self.time is not None else "its exposure time cannot be set: turn its mode dial to M"

    @property
    def knows_make(self) -> bool:
        """Return whether rig knows more than the standard about this make."""
        return False

    @property
    def remembers(self) -> bool:
        """Return whether a new session can fetch a shot that an earlier one began; a card keeps it."""
        return True

    def describe(self, code: int) -> DevicePropDesc:
        """A property as it is now."""
        return self.session.describe(code)

    def write(self, code: int, value: Value) -> None:
        """Set a property."""
        self.session.write_property(code, value)

    def wait_ready(self) -> None:
        """Wait until it accepts orders; events of earlier shots are discarded."""
        drain(self.session, self.earlier)

    def recount(self) -> None:
        """Count the files on the card anew after a failed shot: its leftovers do not belong to the next
        one.
        """
        self.earlier.update(self.session.handles())

    def release(self, patience: float = PATIENCE) -> None:
        """Begin the exposure; CameraBusy if it does not take the order for `patience` seconds."""
        self.session.run(Operation.INITIATE_CAPTURE, 0, 0, repeatable=False, patience=patience)

    def wait(self, exposure: float) -> list[Download]:
        """All objects of the shot that was begun; `exposure` is its time in seconds."""
        return wait_for_objects(self.session, self.earlier, exposure)

    def auto_brackets(self) -> tuple[AutoBracket, ...]:
        """Brackets that it shoots by itself and that can be set remotely."""
        return ()

    def set_auto_bracket(self, bracket: AutoBracket | None) -> None:
        """Set the bracket of the next release, None: a single frame. CameraRefused if it does not accept
        it.
        """
        raise CameraRefused(NO_BRACKET)

    def shoot_bracket(self, bracket: AutoBracket, seconds: float) -> Generator[Download, None, None]:
        """Release, and give each frame when it is stored: it has to be fetched and discarded before the next.

        seconds: all exposures together. CameraTimeout if a frame does not come.
        """
        raise CameraRefused(NO_BRACKET)

    def handles_of(self, file: Download) -> tuple[int, ...]:
        """Handles that a file of an earlier session may have now, likeliest first."""
        return (file.handle, *reversed(self.session.handles()))

    def fetch(self, file: Download) -> bytes:
        """The bytes of an object; goes on where it stopped."""
        return self.session.download(file)

    def discard(self, file: Download) -> None:
        """Release an object that is fetched or not wanted; on a card it stays."""

    def stated_size(self) -> tuple[int, int]:
        """Width and height by the property that holds them as `6048x4024`; zeros without it."""
        if PropertyCode.IMAGE_SIZE in self.session.info.properties:
            width, _, height = str(self.session.describe(PropertyCode.IMAGE_SIZE).current).partition("x")
            if width.isdecimal() and height.isdecimal():
                return int(width), int(height)
        return 0, 0

    def _is_fuji(self) -> bool:
        """Recognise Fujifilm by DeviceInfo's vendor extension, or by name where that says Microsoft."""
        info = self.session.info
        named = f"{info.manufacturer} {info.vendor_description}".lower()
        return info.vendor_extension == VendorId.FUJI or "fujifilm" in named

    def _dial(self, setting: tuple[int, Coding]) -> Dial | None:
        code, coding = setting
        return Dial(self, code, coding) if code in self.listed else None
