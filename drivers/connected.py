"""Every camera that is connected, whatever it speaks, and what it says of itself."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from drivers import ptp, u3v
from drivers.camera import Camera, CameraIdentity, Capabilities
from drivers.clock import Clock
from drivers.ptp import PtpCamera
from imaging.errors import CameraError

Protocol = Literal["PTP", "USB3 Vision"]

U3V_VERIFIED = "the simulator; its description by the package genicam and by Aravis"


@dataclass(frozen=True)
class Listed:
    """One connected camera; `error` says why a camera could not be asked, and the rest is then None.

    verified: what our driver for its make has been tried against.
    """

    protocol: Protocol
    where: str
    identity: CameraIdentity | None = None
    capabilities: Capabilities | None = None
    verified: str = ""
    error: str = ""


def find_cameras(backend: Any, clock: Clock) -> list[Camera]:
    """A driver for every connected camera; none is opened."""
    return [*ptp.find_cameras(backend, clock), *u3v.find_cameras(backend, clock)]


def ask_all(backend: Any, clock: Clock) -> Iterator[Listed]:
    """Open each connected camera, ask what it is, and let it go."""
    for camera in find_cameras(backend, clock):
        still = isinstance(camera, PtpCamera)
        protocol: Protocol = "PTP" if still else "USB3 Vision"
        where = camera.where if isinstance(camera, PtpCamera) else ""
        try:
            verified = camera.verified() if isinstance(camera, PtpCamera) else U3V_VERIFIED
            yield Listed(protocol, where, camera.identify(), camera.capabilities(), verified)
        except CameraError as error:
            yield Listed(protocol, where, error=str(error))
        finally:
            camera.close()
