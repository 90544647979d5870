"""Goals and limits of a planned bracket, in a module that imports nothing heavy."""

from dataclasses import dataclass
from typing import Annotated

from imaging.request import Request


@dataclass(frozen=True)
class BracketGoals(Request):
    """Goals and limits of a planned bracket; None: the cameras' own limits."""

    snr: Annotated[float, "Signal-to-noise ratio to reach in the darkest parts of the scene, dB."] = 20.0
    slowest: Annotated[float | None, "Longest exposure, s, such as 1/30 or 2s."] = None
    total: Annotated[float | None, "Longest bracket, all exposures added up, s, such as 10s."] = None
    highest_iso: Annotated[float | None, "Highest ISO."] = None
