"""Sources of shots: connected cameras, or a simulated rig, with one interface."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol

from capture.bracket.goals import BracketGoals
from capture.request import Stops
from drivers.camera import Camera
from drivers.clock import Clock
from imaging.choices import Subject
from imaging.optics.exposure import Exposure
from imaging.progress import Progress
from imaging.session.lamps import LampsRecord
from imaging.session.records import Band, Board, CameraRecord, PlanRecord
from imaging.session.session import Session
from imaging.session.turntable import TurntableRecord


class Operator(Protocol):
    """Puts things before the cameras: a person at a terminal, or the simulator."""

    def show(self, kind: Subject) -> None:
        """Set the subject of the cameras from now on."""
        ...

    def move_to(self, frame: int) -> None:
        """Move rig and scene to that frame."""
        ...

    def turn_to(self, band: str) -> None:
        """Turn the filter wheels of all cameras to that filter; InputError if they cannot be turned."""
        ...


@dataclass(frozen=True)
class Source:
    """Cameras, and what is usual with them where nothing is asked for."""

    called: str
    """Name in messages."""
    origin: str
    seed: int | None
    records: tuple[CameraRecord, ...]
    """These three as session.json has them."""
    cameras: Mapping[str, Camera]
    """Cameras by name."""
    clock: Clock
    """Clock of the cameras' drivers."""
    operator: Operator
    bracket: tuple[Exposure, ...] | Stops | BracketGoals
    """Exposures, stops around the middle one, or what a planned bracket has to reach."""
    middle: Exposure | None
    """The exposure that stops count from; metered if None."""
    f_number: float | None
    """F-number of all exposures."""
    iso: float | None
    """ISO of stops around a metered middle exposure; None: the lowest."""
    positions: int | None
    """Largest number of frames of a scene; None: unlimited."""
    frames: int
    """Default number of frames."""
    leader: str | None
    """The camera whose exposure triggers all others by a wire, if one does."""
    tolerance: float
    """Seconds between the shutters of a step that are still together."""
    size: tuple[int, int] | None
    """Width and height of a picture, if they are known before there is one."""
    board: Board | None
    """Board that is shown in plans of kind board."""
    beside: Callable[[Session, PlanRecord, Progress], AbstractContextManager[None]]
    """Callback that writes additional files with the shots of a plan."""
    pixels: Mapping[str, int] = field(default_factory=dict)
    """Photosites of a picture by camera, of those that state it before there is one."""
    bands: tuple[Band, ...] = ()
    """Filters before its cameras; empty without filters."""
    wheel: tuple[str, ...] = ()
    """Filters that are changed at every frame, in this order; empty: each camera keeps its own."""

    turntable: TurntableRecord | None = None
    """Angles of the turntable at the frames of a scene; None without one."""
    lamps: LampsRecord | None = None
    """Lamps of a light dome, one for each frame of a scene; None without one."""

    def close(self) -> None:
        """Let go of the cameras."""
        for camera in self.cameras.values():
            camera.close()
