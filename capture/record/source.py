"""What a session can be shot with: cameras that are connected, or a simulated rig, made alike."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from capture.bracket.planner import BracketGoals
from drivers.camera import Camera
from drivers.clock import Clock
from imaging.exposure import Exposure
from imaging.files.tiff.dng import Compression
from imaging.progress import Progress
from imaging.session.records import Band, Board, CameraRecord, PlanRecord, Subject
from imaging.session.session import Session

Stops = tuple[float, ...]
"""Exposures relative to a middle one."""


class Operator(Protocol):
    """Puts things before the cameras: a person at a terminal, or the simulator."""

    def show(self, kind: Subject) -> None:
        """Have the cameras look at that from now on."""
        ...

    def move_to(self, frame: int) -> None:
        """Have rig and scene stand as they are to stand in that frame."""
        ...

    def turn_to(self, band: str) -> None:
        """Have every camera look through that filter of its wheel; InputError if nobody can turn it."""
        ...


@dataclass(frozen=True)
class Source:
    """Cameras, and what is usual with them where nothing is asked for."""

    called: str
    """Its name in messages."""
    origin: str
    seed: int | None
    records: tuple[CameraRecord, ...]
    """These three as session.json has them."""
    cameras: Mapping[str, Camera]
    """By name."""
    clock: Clock
    """That of the cameras' drivers."""
    operator: Operator
    bracket: tuple[Exposure, ...] | Stops | BracketGoals
    """Exposures, stops around the middle one, or what a planned bracket has to reach."""
    middle: Exposure | None
    """The exposure that stops count from; metered if None."""
    f_number: float | None
    """Of all exposures."""
    positions: int | None
    """How many frames a scene can have; None: any number."""
    frames: int
    """How many it usually has."""
    leader: str | None
    """The camera whose exposure triggers all others by a wire, if one does."""
    tolerance: float
    """Seconds between the shutters of a step that are still together."""
    size: tuple[int, int] | None
    """Width and height of a picture, if they are known before there is one."""
    board: Board | None
    """What is shown where a board is to be."""
    beside: Callable[[Session, PlanRecord, Progress], AbstractContextManager[None]]
    """What is written along with the shots of a plan."""
    bands: tuple[Band, ...] = ()
    """The filters before its cameras; none: it has no filters."""
    wheel: tuple[str, ...] = ()
    """Those of them that are changed at every frame, in this order; none: each camera keeps its own."""

    def close(self) -> None:
        """Let go of the cameras."""
        for camera in self.cameras.values():
            camera.close()


@dataclass(frozen=True)
class CaptureRequest:
    """What is to be shot. None: what is usual or, where a session is completed, what it was begun with.

    frames: positions of the scene, poses of the board, or repeats of darks and flats. resume: take exactly
    the shots that the last such plan of the session lacks. compression: of RAW files.
    """

    kind: Subject = "scene"
    frames: int | None = None
    bracket: Stops | BracketGoals | None = None
    resume: bool = False
    compression: Compression = "none"
