"""A still camera as a `Camera`: the state machine of one shot, which survives disconnection."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import TypeVar

from usb.backend import IBackend

from drivers import usb
from drivers.camera import CameraFile, CameraIdentity, Capabilities
from drivers.clock import Clock
from drivers.errors import CameraBusy, CameraGone, CameraLost, CameraRefused
from drivers.ptp.autobracket import AutoBracket, shows
from drivers.ptp.bracket_shot import fit_of, shoot, stand
from drivers.ptp.dials import Dials
from drivers.ptp.exposure import dial_values
from drivers.ptp.ip.connection import IpConnection
from drivers.ptp.protocol.connection import Connection, UsbConnection
from drivers.ptp.shot import Shot, StoredShot, fetched, handle_of
from drivers.ptp.vendors.standard import StandardBody
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure

_MOST_OBJECTS = 8
"""Objects of one shot beyond which a camera has renumbered its card."""

_PROMPT = 1.0
"""Seconds for which a camera that was ready may be too busy to expose before it is looked into."""
_DARK_FRAME = 15.0
"""Seconds of a dark frame that the patience with a stored shot allows for anyway."""

T = TypeVar("T")


def find_cameras(backend: IBackend, clock: Clock) -> list["PtpCamera"]:
    """Every connected PTP camera, none of them opened: the first question to one opens it."""
    return [
        PtpCamera(UsbConnection(device, backend, clock), clock)
        for device in usb.find(usb.STILL_IMAGE, backend)
    ]


def cameras_at(places: Iterable[tuple[str, int]], clock: Clock) -> list["PtpCamera"]:
    """The PTP/IP cameras at these hosts and ports, whether they are there or not: none is asked yet."""
    return [PtpCamera(IpConnection(host, port, clock), clock) for host, port in places]


class PtpCamera:
    """One camera, known by its serial number; found again under it after it was unplugged."""

    def __init__(self, connection: Connection, clock: Clock) -> None:
        self._connection, self._clock = connection, clock
        self._body: StandardBody | None = None
        self._wanted: Exposure | None = None
        self.dials = Dials()
        self._shot: Shot | None = None
        self._unconfirmed = False
        """True from a release until its files are there, and after a failed fetch: leftovers may remain."""
        self._ready_body: StandardBody | None = None
        """The body that was ready, and has answered since: it need not be waited for again."""
        self._size, self._bits = (0, 0), 0

    @property
    def where(self) -> str:
        """Last known place on the bus or the network."""
        return self._connection.where

    def identify(self) -> CameraIdentity:
        """Query the identity, also of a camera that then refuses remote control."""
        if self._connection.identity is None:
            try:
                self._with_reconnect(lambda body: None)
            except CameraRefused:
                if self._connection.identity is None:
                    raise
        assert self._connection.identity is not None
        return self._connection.identity

    def verified(self) -> str:
        """Return what the layer for its make has been tried on."""
        return self._with_reconnect(lambda body: body.verified)

    def knows_make(self) -> bool:
        """Return whether its make is one whose ways are known here, beyond the standard's."""
        return self._with_reconnect(lambda body: body.knows_make)

    def capabilities(self) -> Capabilities:
        """Current choices of the settings; sizes and bits are 0 if it does not state them before its first
        picture.
        """
        return self._with_reconnect(self._capabilities)

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Set the nearest exposure the camera lists and return what it reads back.

        ExposureTime has a resolution of 100 us. If several times match, the one nearest to the request is
        assumed. CameraRefused if the camera is not at manual exposure.
        """
        self._shot = self._ready_body = None
        applied = self._with_reconnect(lambda body: self._set(body, exposure))
        self._wanted = exposure
        return applied

    def arm(self) -> None:
        """Wait until the camera accepts orders, and discard its events of earlier shots."""
        self._require(self._wanted is not None, "be armed")
        self._shot = None

        def ready(body: StandardBody) -> None:
            if body is not self._ready_body:
                body.wait_ready()
            if self._unconfirmed:
                body.recount()

        self._with_reconnect(ready)

    def trigger(self) -> float:
        """Expose; the clock's time, s, at which the camera took the order. It is not given twice."""
        self._require(self._wanted is not None, "be triggered")
        body = self._connected()
        times = [choice.value for dial, choice in self.dials.setting.choices if dial is body.time]
        # After a reconnect during a shot, the exposure has not been set again.
        self._require(bool(times), "be triggered")
        self._shot, self._unconfirmed, time = None, True, times[0]
        before, self._ready_body = frozenset(body.earlier), None
        try:
            try:
                body.release(_PROMPT)
            except CameraBusy:  # a picture that was not fetched keeps it so
                body.recount()
                body.wait_ready()
                body.release()
        except CameraLost:
            self._drop()
            raise
        self._shot = Shot(time, self._clock.now() + time, before, body)
        return self._clock.now()

    def collect(self) -> CameraFile:
        """The picture that trigger() took: the RAW file if there is one, else what the camera developed; of a
        camera that gives both, both.

        A camera that is unplugged meanwhile is found again and asked for the shot. CameraTimeout if no
        picture comes, CameraProtocol if it stays damaged.
        """
        frame = self.fetch(self._stored_shot())
        self._shot, self._unconfirmed = None, False
        return frame

    def bracket(self, exposures: Sequence[Exposure]) -> Iterator[CameraFile]:
        """The frames of the body's own bracketing that holds the most of the exposures, as they come.

        CameraRefused, before anything is exposed, if none holds enough of them. After another error the
        camera is let go, and begins anew.
        """
        fit = self._with_reconnect(lambda body: fit_of(body, exposures))
        if fit is None:
            raise CameraRefused(f"{self.where} has no such bracket: set and trigger each exposure.")
        self._shot = self._ready_body = None
        applied = self._with_reconnect(lambda body: self._set(body, fit.middle, fit.bracket))
        self._wanted = fit.middle
        if not shows(applied, fit.middle):
            raise CameraRefused(f"{self.where} stands at {applied}, not at {fit.middle}: set its dial to M.")
        self.arm()
        self._unconfirmed = True
        try:
            body = self._connected()
            for frame in shoot(body, fit):
                self._size, self._bits = (frame.width, frame.height), frame.bit_depth
                if shows(frame.metadata.exposure, fit.middle):
                    self.dials.learn(body, frame.metadata.exposure, self.dials.setting)
                yield frame
        except CameraError:
            self._drop()
            raise
        self._unconfirmed = False

    def keeps(self) -> bool:
        """Return whether its pictures stay on a card, where they can be fetched later."""
        return self._body is not None and self._body.remembers

    def keep(self) -> StoredShot:
        """Wait until the picture that trigger() took is stored. CameraTimeout if none comes."""
        stored = self._stored_shot()
        self._shot, self._unconfirmed = None, False
        return stored

    def fetch(self, stored: StoredShot) -> CameraFile:
        """The picture of a shot that is stored, as `collect` gives it; the next may be exposed meanwhile."""

        def fetch_from(body: StandardBody) -> CameraFile:
            if body is not stored.body:
                if self._shot is not None:
                    self._shot.doubtful = stored.objects is not self._shot.objects
                for file in stored.objects:
                    file.handle = handle_of(body, file)
                stored.body = body
            frame = fetched(body, stored)
            self._size, self._bits = (frame.width, frame.height), frame.bit_depth
            self.dials.learn(body, frame.metadata.exposure, stored.setting)
            return frame

        try:
            return self._with_reconnect(fetch_from)
        except CameraError:
            self._unconfirmed = True
            raise

    def _stored_shot(self) -> StoredShot:
        """The shot that was triggered, once the camera has all its files."""
        shot = self._shot
        self._require(shot is not None, "deliver a picture")
        assert shot is not None

        def wait_for_files(body: StandardBody) -> StoredShot:
            if body is not shot.body:
                self._continue_on(body, shot)
            if not shot.objects:
                rest = shot.ends - self._clock.now()
                # A dark frame as long as the exposure may follow a long one.
                shot.objects = body.wait(max(rest, shot.time - _DARK_FRAME, 0.0))
            return StoredShot(shot.objects, body, self.dials.setting)

        return self._with_reconnect(wait_for_files)

    def close(self) -> None:
        """Give the camera back to its own buttons and let go; a second time does nothing."""
        body, self._body = self._body, None
        self._shot = self._ready_body = None
        self.dials.forget()  # what is turned on the camera meanwhile counts
        if body is not None:
            with suppress(CameraError):
                stand(body, None)
            with suppress(CameraError):
                body.leave()
            body.session.close()

    def _require(self, fit: bool, what: str) -> None:
        if not fit:
            raise CameraError(
                f"{self.where} cannot {what} yet: call set_exposure, arm, trigger and collect in this order."
            )

    def _with_reconnect(self, act: Callable[[StandardBody], T]) -> T:
        """Run an action; once more if the camera was unplugged and came back."""
        for last in (False, True):
            try:
                return act(self._connected())
            except CameraLost as error:
                self._drop()
                if last or isinstance(error, CameraGone):  # which was waited for already
                    raise
        raise AssertionError  # one of the two returned or raised

    def _connected(self) -> StandardBody:
        """The camera, opened if it is not; CameraGone if it does not come back."""
        if self._body is None:
            self._body = self._connection.open()
            if self._wanted is not None and self._shot is None:
                self._set(self._body, self._wanted)
        return self._body

    def _drop(self) -> None:
        body, self._body = self._body, None
        self.dials.forget()
        if body is not None:
            body.session.transport.close()

    def _capabilities(self, body: StandardBody) -> Capabilities:
        width, height = self._size if self._size[0] else body.stated_size()
        times, f_numbers, isos = map(dial_values, (body.time, body.f_number, body.iso))
        return Capabilities(width, height, self._bits, times, f_numbers, isos, body.obstacle())

    def _set(self, body: StandardBody, exposure: Exposure, bracket: AutoBracket | None = None) -> Exposure:
        """bracket: what a body that stands at it is left at; else it is set to single frames."""
        if body.time is None:
            raise CameraRefused(f"{self.where} has no exposure time to set: turn its mode dial to M.")
        body.wait_ready()
        if body.standing != bracket:
            stand(body, None)
        self._ready_body = body
        return self.dials.set(body, exposure, self._clock.sleep, afresh=self._unconfirmed)

    def _continue_on(self, body: StandardBody, shot: Shot) -> None:
        """Take a shot up again in a new session: the same files under whatever handles they have now."""
        if shot.doubtful:
            self._clock.sleep(max(0.0, shot.ends - self._clock.now()))
            raise CameraRefused(f"{self.where} was unplugged with two shots in it: take the later one again.")
        if not shot.objects:
            new = body.earlier - shot.earlier
            if len(new) > _MOST_OBJECTS or not body.remembers:
                raise CameraRefused(f"{self.where} no longer knows the shot: take it again.")
            body.earlier -= new
        for file in shot.objects:
            file.handle = handle_of(body, file)
        shot.body = body
