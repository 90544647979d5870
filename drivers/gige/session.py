"""An opened GigE Vision device: control of it, its features and its stream."""

import threading

from drivers.clock import Clock
from drivers.errors import CameraNotFound
from drivers.genicam.chunks import ByteOrder
from drivers.genicam.nodemap import NodeMap
from drivers.gige.actions import NetworkTime
from drivers.gige.control import ControlChannel
from drivers.gige.network import Network
from drivers.gige.registers import About, BootstrapClock, read_xml
from drivers.gige.stream import StreamChannel
from imaging.errors import CameraError


class GigeSession:
    """The device from open to close; errors are those of its parts."""

    chunk_order: ByteOrder = "big"
    nodes: NodeMap
    stream: StreamChannel

    def __init__(self, about: About, clock: Clock) -> None:
        self.make, self.model = about.make, about.model
        self.control = ControlChannel(about.address, clock)
        self.where = self.control.where
        self.device_clock = BootstrapClock(self.control)
        try:
            self.control.take()
            self.nodes = NodeMap(read_xml(self.control, about.address), self.control, self.where)
            self.stream = StreamChannel(self.control, lambda: int(self.nodes.number("PayloadSize")), clock)
        except CameraError:
            self.control.close()
            raise

    def close(self) -> None:
        """Let go of the device; a second time does nothing."""
        self.stream.close()
        self.control.close()


def open_session(serial: str, network: Network, clock: Clock, patience: float = 0.0) -> GigeSession:
    """Open the device with that serial number; it may take `patience` s to appear. CameraNotFound."""
    deadline = clock.now() + patience
    while True:
        refused: CameraError | None = None
        # One with several interfaces answers at each, and is controlled at one of them alone.
        for about in network.discover():
            if about.serial != serial:
                continue
            try:
                return GigeSession(about, clock)
            except CameraError as error:
                refused = refused or error
        if refused is not None:
            raise refused
        if clock.now() >= deadline:
            raise CameraNotFound(
                f"camera {serial} does not answer on the network: check its cable, its power and its address."
            )
        clock.sleep(min(0.1, max(deadline - clock.now(), 0.001)))


class ActionTeam:
    """Made once for a rig, and joined by each of its cameras; for any thread.

    time: the time that the cameras share, once they do.
    """

    def __init__(self) -> None:
        self.time = NetworkTime()
        self._addresses: dict[str, str] = {}
        self._synchronised: dict[str, bool] = {}
        self._lock = threading.Lock()

    def note(self, serial: str, address: str, *, synchronised: bool) -> None:
        """Record a camera's address, and whether it keeps the common time."""
        with self._lock:
            self._addresses[serial], self._synchronised[serial] = address, synchronised

    @property
    def addresses(self) -> tuple[str, ...]:
        """Addresses of all cameras."""
        with self._lock:
            return tuple(self._addresses.values())

    @property
    def synchronised(self) -> bool:
        """True if all cameras keep one time."""
        with self._lock:
            return bool(self._synchronised) and all(self._synchronised.values())
