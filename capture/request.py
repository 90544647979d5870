"""Options that a user gives a capture, in a module that imports nothing heavy."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from capture.bracket.goals import BracketGoals
from imaging.choices import Compression, Subject
from imaging.request import Request

if TYPE_CHECKING:
    from usb.backend import IBackend

    from capture.record.source import Operator
    from drivers.clock import Clock
    from drivers.gige import Network

Stops = tuple[float, ...]
"""Exposures relative to a middle one."""


@dataclass(frozen=True)
class CaptureRequest(Request):
    """Options of a capture; None: the default, or the value that a resumed session was begun with."""

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
        bool,
        "Take the shots missing from the last plan of this kind (scene, darks, flats or board); do not meter "
        "again.",
    ] = False
    compression: Annotated[Compression, "Compression of the RAW files."] = "none"


@dataclass(frozen=True)
class RigRequest(CaptureRequest):
    """Options of a capture with the cameras of a rig file. None: this machine's."""

    operator: Annotated[
        "Operator | None", "Moves rig, scene, lens caps and boards; if not given, nothing moves."
    ] = None
    positions: Annotated[int | None, "Number of positions that the operator offers."] = None
    backend: Annotated["IBackend | None", "USB bus of the cameras."] = None
    network: Annotated["Network | None", "Network of the cameras, and those of the nodes in the file."] = None
    clock: Annotated["Clock | None", "Clock of the drivers."] = None
    ray: Annotated[
        str, "HOST:PORT of the cluster that the nodes joined by rig node; auto: this machine's."
    ] = "auto"
