"""What a session can be shot with: cameras that are connected, or a simulated rig, made alike."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Literal, Protocol

from capture.planner import Wanted
from capture.recorder import Progress
from drivers.camera import Camera
from drivers.clock import Clock
from imaging.exposure import Exposure
from imaging.records import CameraRecord, PlanRecord
from imaging.session import Session

Subject = Literal["scene", "dark", "flat", "board"]
"""What the cameras look at."""

Stops = tuple[float, ...]
"""Exposures relative to a middle one."""


class Hands(Protocol):
    """Whoever puts things before the cameras: a person at a terminal, or the simulator."""

    def show(self, kind: Subject) -> None:
        """Have the cameras look at that from now on."""
        ...

    def move_to(self, frame: int) -> None:
        """Have rig and scene stand as they are to stand in that frame."""
        ...


@dataclass(frozen=True)
class Source:
    """Cameras, and what is usual with them where nothing is asked for.

    origin, seed, records: as session.json names them. cameras: by name; clock: that of their drivers.
    called: what messages call it. bracket: its usual exposures, stops around the middle one, or what a
    planned bracket has to reach. middle: exposure that stops count from, metered if None. f_number: of all
    exposures. positions: how many there are for scenes; None: as many as one likes. frames: the usual number.
    size: of a picture, (width, height), if it is known before there is one. beside: what is written
    along with a plan's shots. close: lets go of the cameras.
    """

    called: str
    origin: str
    seed: int | None
    records: tuple[CameraRecord, ...]
    cameras: Mapping[str, Camera]
    clock: Clock
    hands: Hands
    bracket: tuple[Exposure, ...] | Stops | Wanted
    middle: Exposure | None
    f_number: float | None
    positions: int | None
    frames: int
    size: tuple[int, int] | None
    beside: Callable[[Session, PlanRecord, Progress], AbstractContextManager[None]]

    def close(self) -> None:
        """Let go of the cameras."""
        for camera in self.cameras.values():
            camera.close()


@dataclass(frozen=True)
class Request:
    """What is to be shot. None: what is usual or, where a session is completed, what it was begun with.

    frames: positions of the scene, poses of the board, or repeats of darks and flats.
    """

    kind: Subject = "scene"
    frames: int | None = None
    bracket: Stops | Wanted | None = None
