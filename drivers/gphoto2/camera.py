"""A still camera that libgphoto2 drives, as any other `Camera`."""

from collections.abc import Callable, Iterable
from pathlib import PurePosixPath
from typing import TypeVar

from drivers.camera import CameraFile, CameraIdentity, Capabilities
from drivers.clock import Clock
from drivers.errors import CameraLost, CameraProtocol, CameraRefused
from drivers.gphoto2 import dials
from drivers.gphoto2.body import Body, Place
from drivers.gphoto2.library import SCHEME, detected
from drivers.gphoto2.process import BodyProcess
from drivers.ptp.ip.packets import PORT
from imaging.errors import CameraError, InputError
from imaging.files import photo, raw
from imaging.optics.exposure import Exposure

NETWORK = "PTP/IP Camera"
"""Model name that libgphoto2 gives any camera on a port `ptpip:`."""

ResultT = TypeVar("ResultT")


def find_cameras(clock: Clock) -> list["Gphoto2Camera"]:
    """Every camera on the USB that libgphoto2 knows, none of them opened. CameraRefused without it."""
    return [Gphoto2Camera(model, port, clock) for model, port in detected()]


def cameras_at(places: Iterable[tuple[str, int]], clock: Clock) -> list["Gphoto2Camera"]:
    """The PTP/IP cameras at these hosts and ports, whether they are there or not: none is asked yet."""
    return [Gphoto2Camera(NETWORK, f"ptpip:{host}:{port}:{port}", clock) for host, port in places]


class Gphoto2Camera:
    """Opened by the first question, and again after it was lost, where it was.

    libgphoto2 exposes and stores in one call: `trigger` returns when the picture is stored, and when within
    that time the shutter opened is not known.
    """

    def __init__(self, model: str, port: str, clock: Clock) -> None:
        """model, port: as libgphoto2 calls them."""
        self._model, self.port, self._clock = model, port, clock
        self._body: BodyProcess | None = None
        self._identity: CameraIdentity | None = None
        self._wanted: Exposure | None = None
        self._armed = False
        self._shot: Place | None = None
        self._size, self._bits = (0, 0), 0

    @property
    def where(self) -> str:
        """The port of libgphoto2, as the command line has it."""
        kind, *rest = self.port.split(":")
        if kind == "ptpip":  # libgphoto2 wants the port of commands and that of events
            rest = rest[:1] if rest[1:2] == [str(PORT)] else rest[:2]
        return f"{SCHEME}{':'.join([kind, *rest])}"

    def verified(self) -> str:
        """Simulated bodies, and libgphoto2's own: no hardware yet."""
        return "simulated Canon, Nikon, Sony and plain PTP bodies, and libgphoto2's virtual camera"

    def identify(self) -> CameraIdentity:
        """Query the identity; the port stands in for a missing serial number."""
        if self._identity is None:
            self._identity = self._again(self._identified)
        return self._identity

    def capabilities(self) -> Capabilities:
        """Return what it can be set to now; sizes and bits are 0 before its first picture."""
        return self._again(self._able)

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Set the nearest exposure that the body lists and return what it reads back. CameraRefused."""
        self._armed, self._shot = False, None
        applied = self._again(lambda body: self._set(body, exposure))
        self._wanted = exposure
        return applied

    def arm(self) -> None:
        """See that it is open and set."""
        if self._wanted is None:
            raise self._too_early("be armed")
        self._again(lambda body: None)
        self._armed, self._shot = True, None

    def trigger(self) -> float:
        """Expose; the clock's time, s, at which the order was given. The picture is stored on return."""
        if not self._armed or self._body is None:
            raise self._too_early("be triggered")
        self._armed, ordered = False, self._clock.now()
        try:
            self._shot = self._body.do(Body.shoot)
        except (
            CameraError
        ):  # libgphoto2 distinguishes a missed focus from a broken link on few bodies: begin anew
            self.close()
            raise
        return ordered

    def collect(self) -> CameraFile:
        """The picture that trigger() took: the RAW file, with the photograph beside it where there is one.

        CameraProtocol: it is no picture that rig reads, or damaged.
        """
        shot, self._shot = self._shot, None
        if shot is None or self._body is None:
            raise self._too_early("deliver a picture")
        frame = self._once(self._body, lambda body: self._fetched(body, shot))
        self._size, self._bits = (frame.width, frame.height), frame.bit_depth
        return frame

    def close(self) -> None:
        """Let go of the camera; a second time does nothing."""
        body, self._body = self._body, None
        self._armed, self._shot = False, None
        if body is not None:
            body.close()

    def _too_early(self, what: str) -> CameraError:
        return CameraError(
            f"{self.where} cannot {what} yet: call set_exposure, arm, trigger and collect in this order."
        )

    def _again(self, act: Callable[[BodyProcess], ResultT]) -> ResultT:
        """Run an idempotent action; if the camera is lost meanwhile, reopen it and repeat."""
        if self._body is not None:
            try:
                return self._once(self._body, act)
            except CameraLost:
                pass
        return self._once(self._opened(), act)

    def _once(self, body: BodyProcess, act: Callable[[BodyProcess], ResultT]) -> ResultT:
        """Run an action once; close a camera that is lost."""
        try:
            return act(body)
        except CameraLost:
            self.close()
            raise

    def _opened(self) -> BodyProcess:
        if self._body is None:
            self._body = BodyProcess(self._model, self.port, self.where)
            if self._wanted is not None:
                self._set(self._body, self._wanted)
        return self._body

    def _identified(self, body: BodyProcess) -> CameraIdentity:
        serial = body.do(Body.text, "serialnumber") or self.port
        make, model = (
            body.do(Body.text, "manufacturer", "unknown"),
            body.do(Body.text, "cameramodel", self._model),
        )
        return CameraIdentity(serial, make, model, "raw" if body.do(Body.delivers_raw) else "ldr")

    def _able(self, body: BodyProcess) -> Capabilities:
        times = _numbers(body, dials.TIMES, dials.seconds)[1].values()
        f_numbers = _numbers(body, dials.F_NUMBERS, dials.f_number)[1].values()
        isos = _numbers(body, dials.ISOS, dials.iso)[1].values()
        obstacle = "" if times else "its exposure time cannot be set: turn its mode dial to M"
        if not body.do(Body.can_shoot):
            obstacle = "libgphoto2 cannot trigger it"
        return Capabilities(*self._size, self._bits, tuple(times), tuple(f_numbers), tuple(isos), obstacle)

    def _set(self, body: BodyProcess, exposure: Exposure) -> Exposure:
        time = _nearest(body, dials.TIMES, dials.seconds, exposure.time)
        if time is None:
            raise CameraRefused(f"{self.where} has no exposure time to set: turn its mode dial to M.")
        return Exposure(
            time=time,
            f_number=_nearest(body, dials.F_NUMBERS, dials.f_number, exposure.f_number),
            iso=_nearest(body, dials.ISOS, dials.iso, exposure.iso),
        )

    def _fetched(self, body: BodyProcess, shot: Place) -> CameraFile:
        files = [place for place in (shot, body.do(Body.beside, shot)) if place is not None]
        files.sort(key=lambda place: _suffix(place) not in raw.SUFFIXES)
        first, *others = files
        kind = _suffix(first)
        if not kind:
            raise CameraProtocol(f"{self.where} delivered {first[1]}, which rig cannot read: set it to RAW.")
        data = body.do(Body.fetch, first)
        beside = next(((_suffix(one), body.do(Body.fetch, one)) for one in others if _suffix(one)), None)
        try:
            frame = _camera_file(data, kind, first[1], beside)
        except InputError as error:
            raise CameraProtocol(f"{self.where} delivered a damaged file: {error}") from error
        for place in files:
            body.do(Body.forget, place)
        return frame


def _suffix(place: Place) -> str:
    """Suffix of a picture's name, in lower case; empty if rig does not read such files."""
    suffix = PurePosixPath(place[1]).suffix.lower()
    return suffix if suffix in raw.SUFFIXES or suffix in photo.SUFFIXES else ""


def _numbers(body: BodyProcess, names: tuple[str, ...], decode: dials.Decode) -> tuple[str, dict[str, float]]:
    """The first of these settings that is numbers that can be set, and those; "" and none without one."""
    for name in names:
        values = dials.choices(body.do(Body.choices, name), decode)
        if values:
            return name, values
    return "", {}


def _nearest(
    body: BodyProcess, names: tuple[str, ...], decode: dials.Decode, wanted: float | None
) -> float | None:
    """Set what is nearest to `wanted`, where that is something, and return what is read back, if a number."""
    name, listed = _numbers(body, names, decode)
    if not listed:
        return None
    if wanted is None:
        return decode(body.do(Body.text, name))
    choice = min(listed, key=lambda one: max(listed[one] / wanted, wanted / listed[one]))
    return decode(body.do(Body.set, name, choice))


def _camera_file(data: bytes, kind: str, name: str, beside: tuple[str, bytes] | None) -> CameraFile:
    """A file by its header; InputError if that shows it to be damaged or cut off."""
    if kind in raw.SUFFIXES:
        head = raw.read_raw_header(data, kind)
        bits = head.white.bit_length()
        return CameraFile(data, kind, head.width, head.height, head.metadata, bits, developed=beside)
    width, height, metadata = photo.read_photo_header(data, name)
    return CameraFile(data, kind, width, height, metadata)
