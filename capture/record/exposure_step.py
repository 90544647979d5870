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
from imaging.exposure import Exposure

PATIENCE = 30.0
"""Seconds for which cameras that are ready wait for one that is not, beyond what the exposure before it
may take: as long as a dark frame, and its own time."""


@dataclass(frozen=True)
class SavedShot:
    """A frame whose file is whole on the disk.

    told: when its camera was told to expose, and opened: when its shutter did open, None where the camera
    does not say that; opened_by: when it had opened at the latest, None where nothing tells; seconds of the
    clock. retries: attempts before this one.
    host: where it comes from, if that is another host.
    unknown: what its driver could not learn of it, a sentence each.
    """

    file: str
    sha256: str
    developed: str | None
    developed_sha256: str | None
    reported: Exposure
    width: int
    height: int
    captured_at: datetime
    told: float
    opened: float | None
    retries: int
    host: HostClock | None = None
    unknown: tuple[str, ...] = ()
    opened_by: float | None = None


@dataclass
class RunState:
    """What the exposure steps of one run share about its cameras.

    late: those that the others went on without, and that are still at it. failures: of each camera at a
    frame and step. halted: why no more is shot.
    """

    late: set[str] = field(default_factory=set)
    failures: Counter[tuple[str, int, int]] = field(default_factory=Counter)
    halted: RigError | None = None


class ExposureStep:
    """A step of the bracket at one frame, and the cameras that are to expose it together.

    number: of the step in the bracket. cameras: those whose frames are wanted. participants: they, and the
    leader that exposes along.
    told: when the camera of each frame was told to expose. began: when that order began to go out.
    opened: when its shutter opened, where it says so.
    outcomes: of every camera, in the end: its file, or why there is none.
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
        self.told: dict[str, float] = {}
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
        """Whether the exposure has begun: who is not ready by then takes no part."""
        with self._clock.lock:
            return self._begun

    def finish(self, camera: str, outcome: SavedShot | RigError) -> None:
        """Record what became of a camera, once and for all; nobody waits for it any longer."""
        with self._clock.lock:
            self.outcomes.setdefault(camera, outcome)
            self._clock.changed()

    def is_over(self) -> bool:
        """Return whether every camera has an outcome."""
        return all(camera in self.outcomes for camera in self.cameras)

    def _follows(self, camera: str) -> bool:
        return self.leader is not None and camera != self.leader

    def _leader_is_here(self) -> bool:
        """Without it nobody else gets a frame: it is waited for even if it was late before."""
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
        """From here on a camera that was not ready takes no part, and gets an error when it arrives."""
        self._begun = True
        for camera in self.participants:
            if camera not in self._ready and camera not in self.outcomes:
                self._state.late.add(camera)
                self.outcomes[camera] = CameraTimeout("it was not ready when the others exposed")
        self._clock.changed()
