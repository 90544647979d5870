"""A node as the host that leads sees it, and its cameras as any other `Camera`."""

import hashlib
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

from capture.nodes.clocks import ClockReading, ComparedClock, Release
from capture.nodes.node import NodeFile, NodeFrame, Scene, ServedCamera
from drivers.camera import CameraFile, CameraIdentity, Capabilities, HostClock
from drivers.clock import Clock
from drivers.errors import CameraProtocol, HostLost
from imaging.errors import RigError
from imaging.optics.exposure import Exposure

Say = Callable[[str], None]
PROBES = 1.0
"""Seconds between the questions to a node that is lost."""


class Link(Protocol):
    """The way to a node; for any thread."""

    def ask(self, what: str, *arguments: Any) -> Any:
        """Return what that method of `Node` returns. HostLost: its process, its host or the network is down;
        other errors are those of the method.
        """
        ...

    def close(self) -> None:
        """Release the node's cameras, if it still responds."""
        ...


@dataclass
class Stage:
    """State common to all cameras of a rig: the moment of their release, and the scene of simulated ones."""

    release: Release
    scene: Scene | None = None


class RemoteNode:
    """A node. say: shows the line that it is lost, or back, or that its clock jumped.

    While it is lost no camera waits for it: questions fail at once, and a separate thread looks
    whether it is back.
    """

    def __init__(self, name: str, link: Link, clock: Clock, stage: Stage, say: Say) -> None:
        self.name, self.stage = name, stage
        self._link, self._say, self.time = link, say, clock
        self.clock = ComparedClock(lambda: float(self.ask("now")), clock, self._clock_jumped)
        self._lost = self._closed = False

    def ask(self, what: str, *arguments: Any) -> Any:
        """Ask as `Link.ask`; the first failure is reported."""
        if self._lost:
            raise HostLost(f"node {self.name} does not answer")
        try:
            return self._link.ask(what, *arguments)
        except HostLost:
            self._now_lost()
            raise

    def close(self) -> None:
        """Look no longer whether it is back; the link stays open."""
        with self.time.lock:
            self._closed = True
            self.time.changed()

    def _now_lost(self) -> None:
        with self.time.lock:
            if self._lost or self._closed:
                return
            self._lost = True
            place = self.time.worker(f"node {self.name}")
        threading.Thread(target=self._await, args=(place,), name=f"node {self.name}", daemon=True).start()
        self._say(
            f"Node {self.name} does not answer, and its cameras get no frames until it is back: start "
            f"rig node {self.name} there. Complete the session with --resume."
        )

    def _await(self, place: AbstractContextManager[object]) -> None:
        """Ask until it answers; its cameras are then open again."""
        with place:
            while not self.time.wait(lambda: self._closed, PROBES):
                try:
                    self._link.ask("report")
                except RigError:  # not there yet, or with a camera too few or too many
                    continue
                self.clock.forget()
                self._lost = False
                self._say(f"Node {self.name} is back, and its cameras take part again.")
                return

    def _clock_jumped(self, by: float) -> None:
        self._say(
            f"The clock of node {self.name} jumped by {by:+.3g} s, and was compared anew: see whether its "
            "host or virtual machine sleeps or is moved."
        )


class _StoredShot(NamedTuple):
    """A shot on a node: its number there, the node's clock, and whether that jumped during the shot."""

    number: int
    reading: ClockReading
    jumped: bool


class RemoteCamera:
    """A camera of a node. Shots stay on the node until they are fetched, while the next one is exposed."""

    def __init__(self, node: RemoteNode, about: ServedCamera) -> None:
        self._node, self._about = node, about
        self._serial = about.identity.serial
        self._clock, self._reading = node.time, ClockReading(0.0, 0.0, 0.0)

    @property
    def where(self) -> str:
        """Name the node."""
        return f"node {self._node.name}, {self._about.where}"

    def verified(self) -> str:
        """Verification as stated by the node's driver."""
        return self._about.verified

    def identify(self) -> CameraIdentity:
        """Identity from the node's discovery: it knows its cameras by their serial numbers."""
        return self._about.identity

    def capabilities(self) -> Capabilities:
        """Capabilities from the node's discovery."""
        return self._about.capabilities

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Set the nearest exposure; what the camera reads back."""
        applied: Exposure = self._node.ask("set_exposure", self._serial, exposure)
        return applied

    def arm(self) -> None:
        """Make ready; clocks are compared before, since nothing waits for it yet."""
        self._reading = self._node.clock.reading()
        self._node.ask("arm", self._serial, self._node.stage.scene)

    def trigger(self) -> float:
        """Expose together with all others that are triggered now; when, on our clock, s."""
        moment, began = self._node.stage.release.moment(), self._clock.now()
        opened: float = self._node.ask("trigger", self._serial, moment + self._reading.offset)
        # It was between question and answer, whatever a clock that jumps says.
        return min(max(opened - self._reading.offset, began), self._clock.now())

    def collect(self) -> CameraFile:
        """The frame, with its own metadata and where it comes from."""
        return self.fetch(self.keep())

    def keeps(self) -> bool:
        """Always: on the node's disk if not in the camera."""
        return True

    def keep(self) -> _StoredShot:
        """Wait until the frame is stored; what `fetch` knows it by."""
        number: int = self._node.ask("keep", self._serial)
        reading = self._node.clock.since(self._reading)
        return _StoredShot(number, reading, jumped=reading is not self._reading)

    def fetch(self, handle: _StoredShot) -> CameraFile:
        """The frame of such a shot. CameraProtocol: it did not arrive as it left, and may be asked again."""
        number, reading, jumped = handle
        frame: NodeFrame = self._node.ask("store", self._serial, number)
        developed = None
        if frame.developed is not None:
            developed = (frame.developed.suffix, self._read(frame.developed))
        data = self._read(frame.file)
        self._node.ask("drop", number)
        metadata = frame.metadata
        if metadata.opened is not None:
            metadata = replace(metadata, opened=None if jumped else metadata.opened - reading.offset)
        return CameraFile(
            data=data,
            suffix=frame.file.suffix,
            width=frame.width,
            height=frame.height,
            metadata=metadata,
            bit_depth=frame.bit_depth,
            developed=developed,
            proven=frame.proven,
            host=HostClock(self._node.name, reading.offset, reading.error, jumped),
        )

    def close(self) -> None:
        """Do nothing: a node closes all its cameras together."""

    def _read(self, file: NodeFile) -> bytes:
        data: bytes = self._node.ask("read", file)
        if hashlib.sha256(data).hexdigest() != file.sha256:
            raise CameraProtocol(
                f"a frame of camera {self._serial} did not arrive as node {self._node.name} wrote it: "
                "fetch it again."
            )
        return data
