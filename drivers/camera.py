"""The `Camera` protocol, which every camera follows, whatever the bus."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata, RawMosaic


@dataclass(frozen=True)
class CameraIdentity:
    """Camera identity. The serial number is the key; ports and addresses may change."""

    serial: str
    make: str
    model: str
    kind: Literal["raw", "ldr"]


@dataclass(frozen=True)
class Capabilities:
    """Settings that a camera offers: times in seconds, ascending.

    obstacle: why it cannot shoot for rig, as half a sentence; empty where it can.
    """

    width: int
    height: int
    bit_depth: int
    times: tuple[float, ...]
    f_numbers: tuple[float, ...]
    isos: tuple[float, ...]
    obstacle: str = ""


@dataclass(frozen=True)
class HostClock:
    """The clock of another host that a camera is connected to, a node, as it was compared with ours.

    offset: how far it is ahead, s; error: by which that may be wrong, s. jumped: whether it was set or stood
    still during the shot; offset and error then cover it before and after.
    """

    node: str
    offset: float
    error: float
    jumped: bool = False


@dataclass(frozen=True)
class CameraFile:
    """A frame as the file that the camera made of it, RAW or developed, its bytes as received."""

    data: bytes
    suffix: str
    width: int
    height: int
    metadata: FrameMetadata
    bit_depth: int = 8
    developed: tuple[str, bytes] | None = None
    """Suffix and bytes of the photograph that the camera made of the same exposure beside its RAW file."""
    proven: bool = False
    """True if rig wrote it itself and its hash is right: it need not be decoded to check that it is whole."""
    host: HostClock | None = None
    """Host that it comes from, if that is another one."""


class Camera(Protocol):
    """One camera, driven in the order set_exposure, arm, trigger, collect. Errors are CameraError."""

    @property
    def where(self) -> str:
        """Last known address on its bus; empty if unknown."""
        ...

    def verified(self) -> str:
        """Return what the driver has been tried against for cameras of this make."""
        ...

    def identify(self) -> CameraIdentity:
        """Query the identity."""
        ...

    def capabilities(self) -> Capabilities:
        """Return what it can be set to."""
        ...

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Set the nearest exposure the camera has and return what it reads back."""
        ...

    def arm(self) -> None:
        """Make ready, so that trigger() takes effect at once."""
        ...

    def trigger(self) -> float:
        """Expose, and return the monotonic time of the order in seconds.

        How much later its shutter opens is not known unless the frame says so, in `FrameMetadata.opened`.
        """
        ...

    def collect(self) -> RawMosaic | CameraFile:
        """The frame that trigger() exposed, with its own metadata."""
        ...

    def close(self) -> None:
        """Let go of the camera."""
        ...


@runtime_checkable
class HardwareTriggered(Protocol):
    """A camera with lines for a hardware trigger."""

    def listen(self, line: str) -> None:
        """Expose on a rising edge of that input."""
        ...

    def drive(self, line: str) -> None:
        """Show on that output that it exposes."""
        ...


@runtime_checkable
class ShootsBrackets(Protocol):
    """A camera that may shoot several exposures on one order, each faster than it could be set."""

    def bracket(self, exposures: Sequence[Exposure]) -> Iterable[RawMosaic | CameraFile]:
        """Yield frames as they come, in the camera's own order; match them to exposures by their metadata.

        Some of those asked for may be missing, and others may be among them. CameraRefused, before anything
        is exposed, if it cannot shoot this bracket; other CameraErrors may end it after any frame.
        """
        ...


@runtime_checkable
class StoresShots(Protocol):
    """A camera that may keep a shot until the next one exposes, so that neither waits for the other."""

    def keeps(self) -> bool:
        """Return whether this one does: `keep` may then be called instead of collect()."""
        ...

    def keep(self) -> Any:
        """Wait until the camera has stored the frame that trigger() exposed; what `fetch` knows it by."""
        ...

    def fetch(self, handle: Any) -> RawMosaic | CameraFile:
        """The frame of such a shot, with its own metadata; also while the next one is exposed."""
        ...
