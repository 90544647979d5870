"""A machine vision camera on USB3 Vision."""

from usb.backend import IBackend

from drivers.clock import Clock
from drivers.genicam.camera import GenicamCamera
from drivers.u3v.session import connected, open_session


class U3vCamera(GenicamCamera):
    """The camera with that serial number, which is the one that USB shows."""

    def __init__(self, serial: str, backend: IBackend, clock: Clock) -> None:
        super().__init__(serial, lambda patience: open_session(serial, backend, clock, patience), clock)

    def verified(self) -> str:
        """The simulator, and its description in two other programs: no hardware yet."""
        return "the simulator; its description by the package genicam and by Aravis"


def find_cameras(backend: IBackend, clock: Clock) -> list[U3vCamera]:
    """The connected cameras whose serial number can be read, by bus and address; none is kept open."""
    return [U3vCamera(serial, backend, clock) for serial in connected(backend)]
