"""A device's side of the cable: queues towards the host, halts, and being pulled out."""

from typing import TYPE_CHECKING

from drivers.sim.device import Device
from drivers.sim.packets import PacketQueue
from drivers.sim.timeline import Timeline

if TYPE_CHECKING:
    from drivers.sim.bus import VirtualBus


class Port:
    """One plugging-in of a device, at one address. Its methods are called with the timeline's lock held."""

    def __init__(self, bus: "VirtualBus", device: Device, address: int) -> None:
        self.bus, self.device, self.address = bus, device, address
        self.gone = False
        self.claims: dict[int, object] = {}
        """Interfaces by number, and the handle that has each."""
        self.halted_out: set[int] = set()
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

    @property
    def timeline(self) -> Timeline:
        """The bus's time."""
        return self.bus.timeline

    def packet(self, endpoint: int) -> int:
        """wMaxPacketSize, bytes."""
        return self._packets[endpoint]

    def queue(self, endpoint: int) -> PacketQueue:
        """What waits for the host on an endpoint."""
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
            self.bus.remove(self)
            if replug_after is not None:
                self.timeline.call_later(replug_after, lambda: self._replug())
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
        self.bus.plug(self.device)
