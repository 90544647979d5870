"""A node as the host that leads sees it, and its cameras as any other `Camera`."""

import hashlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

from capture.nodes.clocks import ClockReading, ComparedClock, Release
from capture.nodes.node import NodeFile, NodeFrame, Scene, ServedCamera
from drivers.camera import CameraFile, CameraIdentity, Capabilities, HostClock
from drivers.clock import Clock
from drivers.errors import CameraLost, CameraProtocol
from imaging.optics.exposure import Exposure

Say = Callable[[str], None]


class NodeLost(CameraLost):
    """A node does not answer: its process, its host or the network is down."""


class Link(Protocol):
    """The way to a node; for any thread."""

    def ask(self, what: str, *arguments: Any) -> Any:
        """Return what that method of `Node` returns. NodeLost; errors are those of the method."""
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
    """A node. say: shows the line that it is lost, or back."""

    def __init__(self, name: str, link: Link, clock: Clock, stage: Stage, say: Say) -> None:
        self.name, self.stage = name, stage
        self._link, self._say = link, say
        self._clock = ComparedClock(lambda: float(self.ask("now")), clock)
        self._lost = False
        self._lock = threading.Lock()

    def ask(self, what: str, *arguments: Any) -> Any:
        """Ask as `Link.ask`; the first failure is reported."""
        was_lost = self._lost  # what was asked before it was lost may be answered after
        try:
            answer = self._link.ask(what, *arguments)
        except NodeLost:
            self._now_lost(True)
            raise
        if was_lost:
            self._now_lost(False)
        return answer

    def clock(self) -> ClockReading:
        """Return how its clock differs from ours."""
        return self._clock.reading()

    def close(self) -> None:
        """Let go of it."""
        self._link.close()

    def _now_lost(self, lost: bool) -> None:
        with self._lock:
            if lost == self._lost:
                return
            self._lost = lost
        if lost:
            self._say(
                f"Node {self.name} does not answer, and its cameras get no frames until it is back: start "
                f"rig node {self.name} there, and complete the session with --resume."
            )
        else:
            self._say(f"Node {self.name} is back.")
            self._clock.forget()


class RemoteCamera:
    """A camera of a node. Shots stay on the node until they are fetched, while the next one is exposed."""

    def __init__(self, node: RemoteNode, about: ServedCamera) -> None:
        self._node, self._about = node, about
        self._serial = about.identity.serial
        self._reading = ClockReading(0.0, 0.0, 0.0)

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
        """Make ready; clocks are compared now, since nothing waits for it yet."""
        self._node.ask("arm", self._serial, self._node.stage.scene)
        self._reading = self._node.clock()

    def trigger(self) -> float:
        """Expose together with all others that are triggered now; when, on our clock, s."""
        moment = self._node.stage.release.moment()
        opened: float = self._node.ask("trigger", self._serial, moment + self._reading.offset)
        return opened - self._reading.offset

    def collect(self) -> CameraFile:
        """The frame, with its own metadata and where it comes from."""
        return self.fetch(self.keep())

    def keeps(self) -> bool:
        """Always: on the node's disk if not in the camera."""
        return True

    def keep(self) -> tuple[int, ClockReading]:
        """Wait until the frame is stored; what `fetch` knows it by."""
        number: int = self._node.ask("keep", self._serial)
        return number, self._reading

    def fetch(self, handle: tuple[int, ClockReading]) -> CameraFile:
        """The frame of such a shot. CameraProtocol: it did not arrive as it left, and may be asked again."""
        number, reading = handle
        frame: NodeFrame = self._node.ask("store", self._serial, number)
        developed = None
        if frame.developed is not None:
            developed = (frame.developed.suffix, self._read(frame.developed))
        data = self._read(frame.file)
        self._node.ask("drop", number)
        opened = frame.metadata.opened
        return CameraFile(
            data=data,
            suffix=frame.file.suffix,
            width=frame.width,
            height=frame.height,
            metadata=replace(frame.metadata, opened=None if opened is None else opened - reading.offset),
            bit_depth=frame.bit_depth,
            developed=developed,
            proven=frame.proven,
            host=HostClock(self._node.name, reading.offset, reading.error),
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
