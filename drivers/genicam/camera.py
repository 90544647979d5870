"""A camera that is driven by its GenICam features, as any other `Camera`, whatever it is connected by."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from enum import Enum
from typing import TypeVar

from drivers.camera import CameraIdentity, Capabilities
from drivers.clock import Clock
from drivers.errors import CameraLost, CameraRefused, CameraTimeout
from drivers.genicam import lines, sequencer, settings, units
from drivers.genicam.chunks import ChunksRefused
from drivers.genicam.lines import Wiring
from drivers.genicam.mosaics import Mosaics
from drivers.genicam.session import Frame, Session
from drivers.genicam.timestamps import Latch, latch, opening
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic

REPLUG = 10.0
"""Seconds that a camera may be away before it counts as gone."""
_GRACE, _LINE_GRACE = 1.0, 5.0
"""Seconds beyond the exposure within which a frame must begin; and where a line has to trigger it first."""

ResultT = TypeVar("ResultT")
Connect = Callable[[float], Session]


class _Stage(Enum):
    IDLE = "idle"
    ARMED = "armed"
    EXPOSED = "exposed"


class GenicamCamera:
    """Opened at first use.

    When it is unplugged, `CameraLost` ends the shot; `set_exposure`, `arm` and `capabilities` find it again
    by its serial number, at whatever address, and set it as it was.
    """

    _no_pulse = (
        "check the cable, that it ends at this line, and that the camera that leads drives its own end."
    )

    def __init__(self, serial: str, connect: Connect, clock: Clock) -> None:
        """`connect(patience)` opens the device with that serial number, waiting for it up to `patience` s."""
        self.serial = serial
        self._connect, self._clock = connect, clock
        self._wiring = Wiring()
        self._session: Session | None = None
        self._mosaics: Mosaics | None = None
        self._wanted: Exposure | None = None
        self._bytes_per_second: int | None = None
        self._stage = _Stage.IDLE
        self._was_open = self._runs = self._single = False
        self._chunks = True
        self._applied: Exposure | None = None
        self._expected: list[Exposure] = []
        """Settings of each frame that is still to come."""
        self._before: Latch | None = None
        """Device clock just before the camera was armed."""
        self._surest: Latch | None = None
        """The most certain of all readings of its clock."""

    @property
    def where(self) -> str:
        """Address on the bus; empty while closed."""
        return "" if self._session is None else self._session.where

    def identify(self) -> CameraIdentity:
        """Read maker and model from the registers; the serial number is the one that selects the camera."""
        make, model = self._again(lambda session: (session.make, session.model))
        return CameraIdentity(self.serial, make, model, "raw")

    def capabilities(self) -> Capabilities:
        """Size and bits as set; times and ISOs as ladders of third stops over what it can be set to."""
        return self._again(lambda session: settings.read_capabilities(session.nodes))

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Set the nearest time and, if an ISO is given, gain; returns what the camera reads back."""
        self._stage = _Stage.IDLE

        def apply(session: Session) -> Exposure:
            self._applied = None
            return settings.set_exposure(session.nodes, exposure)

        applied = self._again(apply)
        self._wanted, self._applied = exposure, applied
        return applied

    def limit_throughput(self, bytes_per_second: int) -> int:
        """Limit the throughput, so that several cameras share a bus; returns the value read back.
        CameraRefused.
        """

        def apply(session: Session) -> int:
            nodes = session.nodes
            settings.set_if_there(nodes, "DeviceLinkThroughputLimitMode", "On")
            name = "DeviceLinkThroughputLimit"
            limits, scale = nodes.limits(name), units.bytes_per_second(nodes, name)
            wanted = min(max(bytes_per_second / scale, limits.low), limits.high)
            step = limits.step or 1
            nodes.set_nearest(name, limits.low + (wanted - limits.low) // step * step)
            return int(nodes.number(name) * scale)

        applied = self._again(apply)
        self._bytes_per_second = bytes_per_second
        return applied

    def listen(self, line: str) -> None:
        """Expose on the rising edge of an input, such as "Line0", from now on. CameraRefused.

        trigger() then fires nothing: arm this camera before the one that drives the line is triggered.
        """
        self._wire(replace(self._wiring, listens_to=line))

    def drive(self, line: str) -> None:
        """Hold an output high while it exposes, for cameras that listen, from now on. CameraRefused."""
        self._wire(replace(self._wiring, drives=line))

    def arm(self) -> None:
        """Agree on the transfers and start the acquisition of one frame, which waits for its trigger."""

        def begin(session: Session) -> None:
            if not self._single:
                session.nodes.set("AcquisitionMode", "SingleFrame")
                self._single = True
            self._start(session, [self._applied or settings.read_exposure(session.nodes)])

        self._again(begin)
        self._stage = _Stage.ARMED

    def trigger(self) -> float:
        """Expose; the clock's time, s, half way through the command that did it.

        A camera that listens fires nothing, and the time is that from which its frame is waited for.
        A command whose answer is lost is sent again: a camera that waits for one frame exposes only once.
        """
        session = self._must_be(_Stage.ARMED, "arm")
        began = self._clock.now()
        ahead = self._once(lambda: self._fire(session))
        self._stage = _Stage.EXPOSED
        return (began + self._clock.now()) / 2 + ahead

    def collect(self) -> RawMosaic:
        """Return the frame, with its exposure time and the moment of opening where the camera reports
        them.
        """
        session = self._must_be(_Stage.EXPOSED, "trigger")
        self._stage = _Stage.IDLE
        return self._once(lambda: self._take(session)[0])

    def bracket(self, exposures: Sequence[Exposure]) -> list[RawMosaic]:
        """A frame for each exposure, changed by the camera itself after one trigger. CameraRefused."""
        self._stage = _Stage.IDLE

        def begin(session: Session) -> Session:
            if not sequencer.can_sequence(session.nodes):
                raise CameraRefused(f"{session.where} has no sequencer: set each exposure and trigger it.")
            settings.stop(session.nodes)
            self._single, self._applied = False, None
            self._start(session, sequencer.program(session.nodes, exposures))
            return session

        try:
            session = self._again(begin)
            self._stage = _Stage.ARMED
            self.trigger()
            frames = self._once(lambda: self._take(session))
            self._once(lambda: sequencer.leave(session.nodes))
        except CameraError:
            # Half programmed, or half way through: the next use sets the camera up from the beginning.
            self.close()
            raise
        self._stage = _Stage.IDLE
        return frames

    def close(self) -> None:
        """Let go of the camera; a second time does nothing."""
        session, self._session = self._session, None
        self._stage = _Stage.IDLE
        if session is not None:
            session.close()

    def _set_up(self, session: Session) -> None:
        """Set what does not change from shot to shot."""
        name = f"camera {self.serial}"
        if not session.nodes.available("TriggerMode"):
            raise CameraRefused(f"{name} cannot be triggered ({session.where}): take one that can.")
        settings.prepare(session.nodes, name)
        settings.switch_chunks(session.nodes, self._chunks)
        lines.apply(session.nodes, name, self._wiring)

    def _fire(self, session: Session) -> float:
        """Trigger it, unless something else does; how long after that its shutter opens, s."""
        if self._wiring.listens_to is None:
            session.nodes.execute("TriggerSoftware")
        return 0.0

    def _must_be(self, stage: _Stage, before: str) -> Session:
        if self._stage is not stage or self._session is None:
            raise CameraError(
                f"camera {self.serial} is {self._stage.value}: call {before} before, in the order "
                "set_exposure, arm, trigger, collect."
            )
        return self._session

    def _again(self, act: Callable[[Session], ResultT]) -> ResultT:
        """Run an idempotent action; if the camera is lost meanwhile, reopen it and repeat."""
        try:
            return self._once(lambda: act(self._opened()))
        except CameraLost:
            return self._once(lambda: act(self._opened()))

    def _once(self, act: Callable[[], ResultT]) -> ResultT:
        """Run an action once; close a camera that is lost."""
        try:
            return act()
        except CameraLost:
            self.close()
            raise

    def _opened(self) -> Session:
        if self._session is None:
            # A camera that was there before may be on its way back.
            patience = REPLUG if self._was_open else 0.0
            session = self._connect(patience)
            self._was_open = True
            try:
                self._set_up(session)
                if self._wanted is not None:
                    self._applied = settings.set_exposure(session.nodes, self._wanted)
            except CameraError:
                session.close()
                raise
            self._session, self._mosaics = session, Mosaics(session, self.serial)
            self._runs = self._single = False
            if self._bytes_per_second is not None:
                self.limit_throughput(self._bytes_per_second)
        return self._session

    def _wire(self, wiring: Wiring) -> None:
        """Take these lines, at once and whenever it is opened; if one is refused, stay with those before."""
        before = self._wiring
        # Opening it sets it up from the beginning; what runs would keep its trigger locked.
        self.close()
        self._wiring = wiring
        try:
            self._again(lambda session: None)
        except CameraRefused:
            self._wiring = before
            raise

    def _start(self, session: Session, expected: Sequence[Exposure]) -> None:
        """Arm the camera: wait for its trigger, then send a frame for each exposure."""
        if self._runs:
            settings.stop(session.nodes)
        self._expected, self._runs = list(expected), True
        session.stream.start()
        settings.lock(session.nodes, True)
        self._before = self._latched(session)
        session.nodes.execute("AcquisitionStart")

    def _take(self, session: Session) -> list[RawMosaic]:
        """The frames that are expected, after which the stream is off."""
        assert self._mosaics is not None
        taken: list[tuple[int, RawMosaic]] = []
        try:
            for exposure in self._expected:
                frame = self._next_frame(session, exposure.time)
                taken.append((frame.leader.timestamp, self._mosaics.of(frame, exposure)))
        except CameraLost:
            raise
        except CameraError as error:
            self._finish(session)
            if self._chunks and isinstance(error, CameraRefused | ChunksRefused):
                # Another frame may be understood without what comes with it.
                self._chunks = False
                settings.switch_chunks(session.nodes, False)
            raise
        after = self._latched(session)
        self._finish(session)
        return [self._timed(mosaic, stamp, after) for stamp, mosaic in taken]

    def _latched(self, session: Session) -> Latch | None:
        """Latch its clock, with about the least uncertainty since it was opened."""
        reading = latch(session.device_clock, session.nodes, self._clock, self._surest)
        if reading is not None and (self._surest is None or reading.uncertainty < self._surest.uncertainty):
            self._surest = reading
        return reading

    def _next_frame(self, session: Session, time: float) -> Frame:
        """The next frame; CameraTimeout says so if its line has not triggered it."""
        line = self._wiring.listens_to
        if line is None:
            return session.stream.next_frame(time + _GRACE)
        try:
            return session.stream.next_frame(time + _LINE_GRACE)
        except CameraTimeout:
            waited = f"{time + _LINE_GRACE:.3g} s"
            raise CameraTimeout(
                f"camera {self.serial} got no pulse on {line} within {waited}: {self._no_pulse}"
            ) from None

    def _timed(self, mosaic: RawMosaic, stamp: int, after: Latch | None) -> RawMosaic:
        """A frame that says when its shutter opened, if its stamp makes sense."""
        metadata = mosaic.metadata
        assert metadata.exposure is not None
        moment = opening(self._before, after, stamp, metadata.exposure.time)
        if moment is None:
            return mosaic
        return replace(mosaic, metadata=replace(metadata, opened=self._moment(stamp, moment.time)))

    def _moment(self, stamp: int, opened: float) -> float:
        """Return when a shutter opened, whose stamp lay between two readings as `opened` says."""
        return opened

    def _finish(self, session: Session) -> None:
        settings.stop(session.nodes)
        session.stream.stop()
        self._runs = False
