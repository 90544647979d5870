"""Sources of shots: connected cameras, or a simulated rig, with one interface."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Annotated, Protocol

from usb.backend import IBackend

from capture.bracket.planner import BracketGoals
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.gige import Network
from imaging.exposure import Exposure
from imaging.files.tiff.dng import Compression
from imaging.progress import Progress
from imaging.request import Request
from imaging.session.records import Band, Board, CameraRecord, PlanRecord, Subject
from imaging.session.session import Session

Stops = tuple[float, ...]
"""Exposures relative to a middle one."""


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
    bands: tuple[Band, ...] = ()
    """Filters before its cameras; empty without filters."""
    wheel: tuple[str, ...] = ()
    """Filters that are changed at every frame, in this order; empty: each camera keeps its own."""

    def close(self) -> None:
        """Let go of the cameras."""
        for camera in self.cameras.values():
            camera.close()


@dataclass(frozen=True)
class CaptureRequest(Request):
    """Options of a capture. None: the default or, where a session is completed, the value it was begun "
    "with."""

    kind: Annotated[Subject, "The scene, or frames for its calibration."] = "scene"
    frames: Annotated[
        int | None,
        "Positions of the rig: if not given, as in the rig file, or all of a simulated rig. Poses of the "
        "board (20 if not given), or repeats of darks and flats (16).",
    ] = None
    bracket: Annotated[
        Stops | BracketGoals | None,
        "Stops relative to the middle exposure, or the goals of a bracket that is metered and planned "
        "before the first shot. If not given, as in the rig file, or the simulated rig's own.",
    ] = None
    resume: Annotated[
        bool, "Take exactly the shots that the last such plan of the session lacks; nothing is metered again."
    ] = False
    compression: Annotated[Compression, "Compression of the RAW files."] = "none"


@dataclass(frozen=True)
class RigRequest(CaptureRequest):
    """Options of a capture with the cameras of a rig file. None: this machine's."""

    operator: Annotated[
        Operator | None, "Moves rig, scene, lens caps and boards; if not given, nothing moves."
    ] = None
    positions: Annotated[int | None, "Number of positions that the operator offers."] = None
    backend: Annotated[IBackend | None, "USB bus of the cameras."] = None
    network: Annotated[Network | None, "Network of the cameras, and those of the nodes in the file."] = None
    clock: Annotated[Clock | None, "Clock of the drivers."] = None
    ray: Annotated[
        str, "HOST:PORT of the cluster that the nodes joined by `rig node`; auto: this machine's."
    ] = "auto"
