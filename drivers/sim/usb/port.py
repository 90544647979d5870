"""A device on the virtual bus, and its side of the cable: queues, halts, and being pulled out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from drivers.sim.usb.descriptors import Description
from drivers.sim.usb.packets import PacketQueue
from drivers.sim.usb.timeline import Timeline


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
        """Descriptors of the device."""
        ...

    def on_attach(self, port: "Port") -> None:
        """Attach; `port` is its side of the cable until it is unplugged."""
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


class Port:
    """One plugging-in of a device, at one address. Its methods are called with the timeline's lock held."""

    def __init__(
        self,
        timeline: Timeline,
        device: Device,
        address: int,
        removed: Callable[["Port"], None],
        plug: Callable[[Device], "Port"],
    ) -> None:
        """removed: called when the cable is pulled out. plug: puts a device back on the bus."""
        self.timeline, self.device, self.address = timeline, device, address
        self._removed, self._plug = removed, plug
        self.gone = False
        self.claims: dict[int, object] = {}
        """Interfaces by number, and the handle that has each."""
        self.halted_out: set[int] = set()
        self.alternates: dict[int, int] = {}
        """Alternate settings by interface, where they are not the first."""
        self._packets = {
            endpoint.address: endpoint.packet
            for interface in device.description.interfaces
            for endpoint in interface.endpoints
        }
        self._queues = {
            address: PacketQueue(size) for address, size in self._packets.items() if address & 0x80
        }
        self._fuse: int | None = None
        self._replug_after: float | None = None

    def packet(self, endpoint: int) -> int:
        """wMaxPacketSize, bytes."""
        return self._packets[endpoint]

    def queue(self, endpoint: int) -> PacketQueue:
        """Return what waits for the host on an endpoint."""
        return self._queues[endpoint]

    def send(self, endpoint: int, data: bytes) -> None:
        """Queue a transfer, with a zero-length packet if its last packet is full."""
        if not self.gone:
            self._queues[endpoint].put_transfer(data)
            self.timeline.changed()

    def send_open(self, endpoint: int, data: bytes) -> None:
        """Queue packets whose last may be full: a transfer that does not say where it ends."""
        if not self.gone:
            self._queues[endpoint].put(data)
            self.timeline.changed()

    def halt(self, endpoint: int) -> None:
        """Halt an endpoint; what waited there is lost."""
        if endpoint & 0x80:
            queue = self._queues[endpoint]
            queue.clear()
            queue.halted = True
        else:
            self.halted_out.add(endpoint)
        self.timeline.changed()

    def halted(self) -> tuple[int, ...]:
        """The endpoints that are halted, by address."""
        incoming = {address for address, queue in self._queues.items() if queue.halted}
        return tuple(sorted(incoming | self.halted_out))

    def clear_halt(self, endpoint: int) -> None:
        """The host lets an endpoint go on."""
        self.halted_out.discard(endpoint)
        if endpoint in self._queues:
            self._queues[endpoint].halted = False
        self.device.on_clear_halt(endpoint)

    def reset(self) -> None:
        """The host resets the device."""
        self.halted_out.clear()
        self.alternates.clear()
        for queue in self._queues.values():
            queue.clear()
            queue.halted = False
        self.device.on_reset()

    def unplug(self, replug_after: float | None = None) -> None:
        """Pull the cable out and, that many seconds later, put it back: same serial, new address."""
        with self.timeline.lock:
            if self.gone:
                return
            self.gone = True
            self._removed(self)
            if replug_after is not None:
                self.timeline.call_later(replug_after, self._replug)
            self.timeline.changed()

    def unplug_at(self, count: int, replug_after: float | None = None) -> None:
        """Pull the cable out as soon as the host has read `count` more bytes."""
        self._fuse, self._replug_after = count, replug_after

    def spend(self, count: int) -> bool:
        """The host read `count` bytes; whether the device is still there."""
        if self._fuse is not None:
            self._fuse -= count
            if self._fuse <= 0:
                self._fuse = None
                self.unplug(self._replug_after)
        return not self.gone

    def _replug(self) -> None:
        self._plug(self.device)
