"""Interface between a transport, USB3 Vision or GigE Vision, and the camera above it."""

from dataclasses import dataclass
from typing import Protocol

from drivers.genicam.chunks import ByteOrder
from drivers.genicam.nodemap import NodeMap
from imaging.arrays import Bytes


@dataclass(frozen=True)
class FrameLeader:
    """Header of a frame. payload_type: an image, with or without chunks. timestamp: of the device's clock.
    pixel_format: PFNC code. padding: bytes after each row."""

    block: int
    payload_type: int
    timestamp: int
    pixel_format: int = 0
    width: int = 0
    height: int = 0
    left: int = 0
    top: int = 0
    padding: int = 0


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame as it came. payload: uint8; problem: what is missing of it, None if nothing is."""

    leader: FrameLeader
    payload: Bytes
    problem: str | None


def fewer_rows(rows: int, height: int) -> str:
    """Return what is the matter with a frame of a camera that may end frames early."""
    return (
        f"the camera ended it after {rows} of {height} rows (variable height): set a fixed height in its "
        "maker's program"
    )


class FrameStream(Protocol):
    """Frames, one after the other."""

    def start(self) -> None:
        """Make ready for frames as the camera is set now; AcquisitionStart comes after."""
        ...

    def stop(self) -> None:
        """No more frames; AcquisitionStop comes before."""
        ...

    def next_frame(self, timeout: float) -> Frame:
        """The next frame, complete or not, that begins within `timeout` s. CameraTimeout if none does."""
        ...


class DeviceClock(Protocol):
    """The registers of a device that show its clock. CameraRefused where it has none."""

    def latch(self) -> None:
        """Keep what the clock shows now."""
        ...

    def latched(self) -> int:
        """Return what was kept."""
        ...


class Session(Protocol):
    """An opened device; errors are those of its parts."""

    @property
    def where(self) -> str:
        """Address on its bus or network, for messages."""
        ...

    @property
    def make(self) -> str:
        """The manufacturer."""
        ...

    @property
    def model(self) -> str:
        """The model."""
        ...

    @property
    def nodes(self) -> NodeMap:
        """Features."""
        ...

    @property
    def stream(self) -> FrameStream:
        """Stream of frames."""
        ...

    @property
    def device_clock(self) -> DeviceClock:
        """Device clock."""
        ...

    @property
    def chunk_order(self) -> ByteOrder:
        """The byte order of the tags between chunks."""
        ...

    def close(self) -> None:
        """Let go of the device; a second time does nothing."""
        ...
