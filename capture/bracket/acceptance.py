"""Acceptance of frames whose own metadata agree with the request."""

from typing import Generic, Protocol, TypeVar

from capture.bracket.deviation import deviates
from imaging.optics.exposure import Exposure

RETRIES = 2
"""Further attempts after a camera error; one bad cable must not hold the rig up for ever."""


class Frame(Protocol):
    """Frame under test."""

    @property
    def reported(self) -> Exposure:
        """The exposure that the frame itself states."""
        ...


Key = TypeVar("Key")
FrameT = TypeVar("FrameT", bound=Frame)


class Acceptance(Generic[Key, FrameT]):
    """Judges the frames of one step, by camera or shot. doubtful: the first of each that did not agree.

    A frame is accepted when its *own* metadata agree with the request, since cameras do hand out the frame
    before; one that does not is taken again once, then kept with what it reports.
    """

    def __init__(self) -> None:
        self.doubtful: dict[Key, FrameT] = {}

    def accepts(self, key: Key, frame: FrameT, requested: Exposure) -> bool:
        """Return whether a frame counts; False asks for another attempt."""
        if key in self.doubtful or not deviates(frame.reported, requested):
            return True
        self.doubtful[key] = frame
        return False
