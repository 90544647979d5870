"""One exposure of the whole rig: where its cameras wait for one another, and what became of each.

Where the exposure of one camera, the leader, triggers all others by a wire, it takes part in every round of
theirs; a round that does not want its frame has it expose along.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime

from drivers.clock import Clock
from drivers.errors import CameraTimeout
from imaging.errors import RigError
from imaging.exposure import Exposure

PATIENCE = 30.0
"""Seconds for which cameras that are ready wait for one that is not, beyond what the exposure before it
may take: as long as a dark frame, and its own time."""


@dataclass(frozen=True)
class Written:
    """A frame whose file is whole on the disk.

    opened: when its shutter opened, seconds of the clock. retries: attempts before this one.
    """

    file: str
    sha256: str
    reported: Exposure
    width: int
    height: int
    captured_at: datetime
    opened: float
    retries: int


@dataclass
class Standing:
    """What the rounds of one run know of the cameras.

    late: those that the others went on without, and that are still at it. failures: of each camera at a
    frame and step. halted: why no more is shot.
    """

    late: set[str] = field(default_factory=set)
    failures: Counter[tuple[str, int, int]] = field(default_factory=Counter)
    halted: RigError | None = None


class Round:
    """A step of the bracket at one frame, and the cameras that are to expose it together.

    cameras: those whose frames are wanted. party: they, and the leader that exposes along.
    opened: when the shutter of each frame opened. outcomes: of every camera, in the end: its file, or why
    there is none.
    """

    def __init__(
        self,
        clock: Clock,
        standing: Standing,
        frame: int,
        step: int,
        requested: Exposure,
        cameras: Sequence[str],
        *,
        patience: float = PATIENCE,
        leader: str | None = None,
    ) -> None:
        self._clock, self._standing = clock, standing
        self.frame, self.step, self.requested = frame, step, requested
        self.cameras = tuple(cameras)
        self.leader = leader
        along = leader is not None and leader not in cameras
        self.party = (*self.cameras, leader) if along and leader is not None else self.cameras
        self.opened: dict[str, float] = {}
        self.outcomes: dict[str, Written | RigError] = {}
        self._patience = patience
        self._come: set[str] = set()
        self._ready: set[str] = set()
        self._deadline = math.inf
        self._begun = False

    def come(self, camera: str) -> None:
        """Be about to make ready; one that is triggered by the leader returns when that is here too.

        Before, the leader may still expose for an earlier round, and would trigger this camera with it.
        """
        with self._clock.lock:
            self._come.add(camera)
            self._clock.changed()
            if not self._follows(camera):
                return
            self._deadline = min(self._deadline, self._clock.now() + self._patience)
        self._clock.wait(self._leader_is_here, self._deadline - self._clock.now())

    def meet(self, camera: str) -> None:
        """Be ready, and return when all others are, or are not to be waited for any longer.

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
            if self._standing.halted is not None:
                raise self._standing.halted
            if not self._begun:
                self._begin()
            if camera not in self._ready:
                raise CameraTimeout("it was not ready when the others exposed")
            if self._follows(camera) and self.leader not in self._ready:
                raise CameraTimeout(f"{self.leader}, whose exposure triggers it, was not ready")

    def failed(self, camera: str) -> None:
        """Count an attempt that gave no frame, or not the one that was asked for."""
        with self._clock.lock:
            self._standing.failures[camera, self.frame, self.step] += 1

    def tries(self, camera: str) -> int:
        """Attempts that failed so far."""
        with self._clock.lock:
            return self._standing.failures[camera, self.frame, self.step]

    @property
    def begun(self) -> bool:
        """Whether it is too late to come."""
        with self._clock.lock:
            return self._begun

    def settle(self, camera: str, outcome: Written | RigError) -> None:
        """Say what became of a camera, once and for all; one that will not come is waited for no longer."""
        with self._clock.lock:
            self.outcomes.setdefault(camera, outcome)
            self._clock.changed()

    def is_over(self) -> bool:
        """Whether all is known that there will be."""
        return all(camera in self.outcomes for camera in self.cameras)

    def _follows(self, camera: str) -> bool:
        return self.leader is not None and camera != self.leader

    def _leader_is_here(self) -> bool:
        """Without it nobody else gets a frame: it is waited for even if it was late before."""
        return self._standing.halted is not None or self.leader in self._come or self.leader in self.outcomes

    def _may_begin(self) -> bool:
        return (
            self._begun
            or self._standing.halted is not None
            or all(
                camera in self._ready or camera in self.outcomes or camera in self._standing.late
                for camera in self.party
            )
        )

    def _begin(self) -> None:
        """From here on nobody may come; those who have not are told so when they do."""
        self._begun = True
        for camera in self.party:
            if camera not in self._ready and camera not in self.outcomes:
                self._standing.late.add(camera)
                self.outcomes[camera] = CameraTimeout("it was not ready when the others exposed")
        self._clock.changed()
