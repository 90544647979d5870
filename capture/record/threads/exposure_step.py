"""One step of the bracket at one frame: where its cameras wait for one another, and what became of each.

Where the exposure of one camera, the leader, triggers all others by a wire, it takes part in every step of
theirs; a step that does not want its frame has it expose along.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime

from drivers.camera import HostClock
from drivers.clock import Clock
from drivers.errors import CameraTimeout
from imaging.errors import RigError
from imaging.optics.exposure import Exposure

PATIENCE = 30.0
"""Seconds for which cameras that are ready wait for one that is not, beyond what the exposure before it
may take: as long as a dark frame, and its own time."""


@dataclass(frozen=True)
class SavedShot:
    """Frame whose file is whole on the disk.

    ordered: time of the order to expose, and opened: time of its shutter's opening, None if the camera does
    not report it; opened_by: latest time of that opening, None if unknown; seconds of the clock. retries:
    attempts before this one. host: origin, if that is another host. unknown: facts that its driver could not
    learn, a sentence each.
    """

    file: str
    sha256: str
    developed: str | None
    developed_sha256: str | None
    reported: Exposure
    width: int
    height: int
    captured_at: datetime
    ordered: float
    opened: float | None
    retries: int
    host: HostClock | None = None
    unknown: tuple[str, ...] = ()
    opened_by: float | None = None


@dataclass
class RunState:
    """State of the cameras that the exposure steps of one run share.

    late: those that the others went on without, and that are still at it. failures: of each camera at a
    frame and step. halted: why no more is shot.
    """

    late: set[str] = field(default_factory=set)
    failures: Counter[tuple[str, int, int]] = field(default_factory=Counter)
    halted: RigError | None = None


class ExposureStep:
    """Step of the bracket at one frame, and the cameras that are to expose it together.

    number: of the step in the bracket. cameras: those whose frames are wanted. participants: they, and the
    leader that exposes along. ordered: time of the order to expose of each frame. began: time at which
    sending the order began. opened: time of its shutter's opening, if reported. outcomes: of every camera, in
    the end: its file, or the reason why it has none.
    """

    def __init__(
        self,
        clock: Clock,
        state: RunState,
        frame: int,
        number: int,
        requested: Exposure,
        cameras: Sequence[str],
        *,
        patience: float = PATIENCE,
        leader: str | None = None,
    ) -> None:
        self._clock, self._state = clock, state
        self.frame, self.number, self.requested = frame, number, requested
        self.cameras = tuple(cameras)
        self.leader = leader
        along = leader is not None and leader not in cameras
        self.participants = (*self.cameras, leader) if along and leader is not None else self.cameras
        self.ordered: dict[str, float] = {}
        self.began: dict[str, float] = {}
        self.opened: dict[str, float] = {}
        self.outcomes: dict[str, SavedShot | RigError] = {}
        self._patience = patience
        self._arrived: set[str] = set()
        self._ready: set[str] = set()
        self._deadline = math.inf
        self._begun = False

    def wait_for_leader(self, camera: str) -> None:
        """Announce a camera before it is made ready; one that the leader triggers waits for that to come too.

        Before, the leader may still expose for an earlier step, and would trigger this camera with it.
        """
        with self._clock.lock:
            self._arrived.add(camera)
            self._clock.changed()
            if not self._follows(camera):
                return
            self._deadline = min(self._deadline, self._clock.now() + self._patience)
        self._clock.wait(self._leader_is_here, self._deadline - self._clock.now())

    def wait_for_others(self, camera: str) -> None:
        """Announce a camera as ready; return when all others are, or are not waited for any longer.

        CameraTimeout if they went on without this one, or the leader is not there to trigger it. The error
        that ended all shooting, if one did.
        """
        with self._clock.lock:
            if not self._begun:
                self._ready.add(camera)
                self._deadline = min(self._deadline, self._clock.now() + self._patience)
                self._clock.changed()
        self._clock.wait(self._may_begin, self._deadline - self._clock.now())
        with self._clock.lock:
            if self._state.halted is not None:
                raise self._state.halted
            if not self._begun:
                self._begin()
            if camera not in self._ready:
                raise CameraTimeout("it was not ready when the others exposed")
            if self._follows(camera) and self.leader not in self._ready:
                raise CameraTimeout(f"{self.leader}, whose exposure triggers it, was not ready")

    def count_failure(self, camera: str) -> None:
        """Count an attempt that gave no frame, or not the one that was asked for."""
        with self._clock.lock:
            self._state.failures[camera, self.frame, self.number] += 1

    def failures(self, camera: str) -> int:
        """Attempts that failed so far."""
        with self._clock.lock:
            return self._state.failures[camera, self.frame, self.number]

    @property
    def begun(self) -> bool:
        """True once the exposure has begun: cameras that are not ready by then take no part."""
        with self._clock.lock:
            return self._begun

    def finish(self, camera: str, outcome: SavedShot | RigError) -> None:
        """Record the final outcome of a camera, and stop waiting for it."""
        with self._clock.lock:
            self.outcomes.setdefault(camera, outcome)
            self._clock.changed()

    def is_over(self) -> bool:
        """Return whether every camera has an outcome."""
        return all(camera in self.outcomes for camera in self.cameras)

    def _follows(self, camera: str) -> bool:
        return self.leader is not None and camera != self.leader

    def _leader_is_here(self) -> bool:
        """Return whether the leader is ready: without it no other camera gets a frame, so it is waited for
        even if late.
        """
        return self._state.halted is not None or self.leader in self._arrived or self.leader in self.outcomes

    def _may_begin(self) -> bool:
        return (
            self._begun
            or self._state.halted is not None
            or all(
                camera in self._ready or camera in self.outcomes or camera in self._state.late
                for camera in self.participants
            )
        )

    def _begin(self) -> None:
        """Begin the exposure: a camera that was not ready takes no part, and gets an error when it
        arrives.
        """
        self._begun = True
        for camera in self.participants:
            if camera not in self._ready and camera not in self.outcomes:
                self._state.late.add(camera)
                self.outcomes[camera] = CameraTimeout("it was not ready when the others exposed")
        self._clock.changed()
