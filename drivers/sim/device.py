"""What a device on the virtual bus is: the protocol that PTP and USB3 Vision devices follow."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from drivers.sim.descriptors import Description

if TYPE_CHECKING:
    from drivers.sim.port import Port


class Stall(Exception):
    """A device's answer to a control request that it does not know or will not do."""


@dataclass(frozen=True)
class Setup:
    """The head of a control transfer."""

    request_type: int
    request: int
    value: int
    index: int
    length: int


class Device(Protocol):
    """A device on the bus. The bus calls it with the timeline's lock held: it answers and never waits."""

    @property
    def description(self) -> Description:
        """What it says of itself."""
        ...

    def on_attach(self, port: "Port") -> None:
        """It was plugged in; `port` is its side of the cable until it is unplugged."""
        ...

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        """A packet from the host, at most wMaxPacketSize bytes, empty ones included."""
        ...

    def on_control(self, setup: Setup, data: bytes) -> bytes:
        """A class or vendor request; returns the data to the host. Stall."""
        ...

    def on_clear_halt(self, endpoint: int) -> None:
        """The host cleared a halt, or set the data toggle back."""
        ...

    def on_reset(self) -> None:
        """The host reset the device; its queues are empty."""
        ...
