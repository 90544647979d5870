"""A machine vision camera on GigE Vision."""

from drivers.clock import Clock
from drivers.genicam.camera import GenicamCamera
from drivers.gige.network import Network
from drivers.gige.session import open_session


class GigeCamera(GenicamCamera):
    """The camera with that serial number, at whatever address."""

    def __init__(self, serial: str, network: Network, clock: Clock, address: str = "") -> None:
        """address: where it was discovered, if it was."""
        super().__init__(serial, lambda patience: open_session(serial, network, clock, patience), clock)
        self._address = address

    @property
    def where(self) -> str:
        """Where it was discovered, or is opened; empty while neither."""
        return super().where or (f"GigE {self._address}" if self._address else "")

    def verified(self) -> str:
        """Cameras in software: no hardware yet."""
        return "the simulator; the fake cameras of Aravis and viva-genicam"


def find_cameras(network: Network, clock: Clock) -> list[GigeCamera]:
    """The cameras that answer, by address; none is opened."""
    return [GigeCamera(about.serial, network, clock, about.address) for about in network.discover()]
