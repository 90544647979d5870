"""A virtual USB bus: a pyusb backend whose devices are Python objects, with the errors of libusb.

Plug devices in, give the bus to whatever talks to pyusb, and it sees packets, halts, time-outs and cables
pulled out as libusb on Linux shows them. Time is that of the bus's timeline: time-outs included.
"""

import errno
import math
from array import array
from collections.abc import Iterator
from enum import Enum
from types import SimpleNamespace

import usb.backend
from usb.core import USBError, USBTimeoutError

from drivers.sim.usb import descriptors
from drivers.sim.usb.descriptors import SUPER_SPEED
from drivers.sim.usb.packets import Overflow
from drivers.sim.usb.port import Device, Port, Setup, Stall
from drivers.sim.usb.requests import control
from drivers.sim.usb.timeline import Timeline

BUS_NUMBER = 1
_MICROFRAME = 125e-6
_RATE = {False: 40e6, True: 400e6}
"""Bytes per second of bulk transfers, by whether the device is a SuperSpeed one."""

_LIBUSB = {
    errno.ETIMEDOUT: (-7, "Operation timed out"),
    errno.ENODEV: (-4, "No such device (it may have been disconnected)"),
    errno.EPIPE: (-9, "Pipe error"),
    errno.EOVERFLOW: (-8, "Overflow"),
    errno.EBUSY: (-6, "Resource busy"),
    errno.EACCES: (-3, "Access denied (insufficient permissions)"),
    errno.ENOENT: (-5, "Entity not found"),
}


class Holder(Enum):
    """Program that holds a device; the value is the error that libusb gives, and its place."""

    NOBODY = 0
    PERMISSIONS = errno.EACCES
    """Opening it fails."""
    KERNEL_DRIVER = errno.EBUSY
    """Claiming an interface fails until the kernel's driver is detached."""
    OTHER_PROGRAM = -errno.EBUSY
    """Claiming an interface fails."""


class _Handle:
    """A device opened once."""

    def __init__(self, port: Port) -> None:
        self.port = port
        self.open = True


def fail(number: int) -> USBError:
    """The error that pyusb's libusb backend raises for that errno."""
    code, text = _LIBUSB[number]
    return (USBTimeoutError if number == errno.ETIMEDOUT else USBError)(text, code, number)


class VirtualBus(usb.backend.IBackend):  # type: ignore[misc]
    """The bus and everything plugged into it; all methods from `enumerate_devices` on are pyusb's."""

    def __init__(self, timeline: Timeline, bandwidth: float | None = None) -> None:
        """bandwidth: bytes per second of bulk transfers, else those of the device's speed."""
        super().__init__()
        self.timeline, self._bandwidth = timeline, bandwidth
        self.open_handles = 0
        self._ports: list[Port] = []
        self._address = 0
        self._holders: dict[str, Holder] = {}

    def plug(self, device: Device) -> Port:
        """Plug a device in, at an address that none had before."""
        with self.timeline.lock:
            self._address += 1
            port = Port(self.timeline, device, self._address, self._ports.remove, self.plug)
            self._ports.append(port)
            device.on_attach(port)
            self.timeline.changed()
            return port

    def unplug(self, serial: str) -> None:
        """Pull the cable of the device with that serial number; LookupError if none is plugged in."""
        self.port(serial).unplug()

    def port(self, serial: str) -> Port:
        """Return where the device with that serial number is plugged in; LookupError if it is not."""
        for port in self._ports:
            if port.device.description.serial == serial:
                return port
        raise LookupError(f"no device {serial} is plugged in")

    def hold(self, serial: str, holder: Holder) -> None:
        """Let another program hold the device, or release it."""
        self._holders[serial] = holder

    def enumerate_devices(self) -> Iterator[Port]:
        """Return what is plugged in now, by address."""
        with self.timeline.lock:
            return iter(tuple(self._ports))

    def get_parent(self, dev: Port) -> None:
        """Every device is at the root."""

    def get_device_descriptor(self, dev: Port) -> SimpleNamespace:
        """The device descriptor, and where the device is."""
        return descriptors.device_descriptor(dev.device.description, BUS_NUMBER, dev.address)

    def get_configuration_descriptor(self, dev: Port, config: int) -> SimpleNamespace:
        """The one configuration. IndexError past it."""
        if config:
            raise IndexError(f"configuration {config} of 1")
        return descriptors.configuration_descriptor(dev.device.description)

    def get_interface_descriptor(self, dev: Port, intf: int, alt: int, config: int) -> SimpleNamespace:
        """An alternate setting. IndexError past the last."""
        return descriptors.interface_descriptor(dev.device.description, intf, alt)

    def get_endpoint_descriptor(
        self, dev: Port, ep: int, intf: int, alt: int, config: int
    ) -> SimpleNamespace:
        """An endpoint. IndexError past the last."""
        return descriptors.endpoint_descriptor(dev.device.description, ep, intf, alt)

    def open_device(self, dev: Port) -> _Handle:
        """Open it: 19 if it is gone, 13 if that is not permitted."""
        with self.timeline.lock:
            if dev.gone:
                raise fail(errno.ENODEV)
            if self._holder(dev) is Holder.PERMISSIONS:
                raise fail(errno.EACCES)
            self.open_handles += 1
            return _Handle(dev)

    def close_device(self, dev_handle: _Handle) -> None:
        """Close it; what it claimed is free."""
        with self.timeline.lock:
            if dev_handle.open:
                dev_handle.open = False
                self.open_handles -= 1
                claims = dev_handle.port.claims
                for number in [number for number, holder in claims.items() if holder is dev_handle]:
                    del claims[number]

    def get_configuration(self, dev_handle: _Handle) -> int:
        """Always 1."""
        with self.timeline.lock:
            self._there(dev_handle)
            return 1

    def set_configuration(self, dev_handle: _Handle, config_value: int) -> None:
        """Only 1 is there; 16 while an interface is claimed."""
        with self.timeline.lock:
            if self._there(dev_handle).claims:
                raise fail(errno.EBUSY)
            if config_value != 1:
                raise fail(errno.ENOENT)

    def set_interface_altsetting(self, dev_handle: _Handle, intf: int, altsetting: int) -> None:
        """A setting that the interface has."""
        with self.timeline.lock:
            port = self._there(dev_handle)
            alternates = port.device.description.alternates(intf)
            if altsetting not in (interface.alternate for interface in alternates):
                raise fail(errno.ENOENT)
            port.alternates[intf] = altsetting

    def claim_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Claim it: 16 if another handle, the kernel's driver or another program has it."""
        with self.timeline.lock:
            port = self._there(dev_handle)
            if intf not in port.device.description.numbers():
                raise fail(errno.ENOENT)
            held = self._holder(port) in (Holder.KERNEL_DRIVER, Holder.OTHER_PROGRAM)
            if held or port.claims.setdefault(intf, dev_handle) is not dev_handle:
                raise fail(errno.EBUSY)

    def release_interface(self, dev_handle: _Handle, intf: int) -> None:
        """Release it."""
        with self.timeline.lock:
            self._there(dev_handle).claims.pop(intf, None)

    def is_kernel_driver_active(self, dev_handle: _Handle, intf: int) -> bool:
        """Return whether the kernel's driver has the device."""
        with self.timeline.lock:
            return self._holder(self._there(dev_handle)) is Holder.KERNEL_DRIVER

    def detach_kernel_driver(self, dev_handle: _Handle, intf: int) -> None:
        """Take the device from the kernel's driver."""
        with self.timeline.lock:
            port = self._there(dev_handle)
            if self._holder(port) is not Holder.KERNEL_DRIVER:
                raise fail(errno.ENOENT)
            self.hold(port.device.description.serial, Holder.NOBODY)

    def attach_kernel_driver(self, dev_handle: _Handle, intf: int) -> None:
        """Give it back."""
        with self.timeline.lock:
            self.hold(self._there(dev_handle).device.description.serial, Holder.KERNEL_DRIVER)

    def bulk_write(self, dev_handle: _Handle, ep: int, intf: int, data: "array[int]", timeout: int) -> int:
        """One transfer to the device, packet by packet; no data is a zero-length packet."""
        sent = data.tobytes()
        self._spend(dev_handle, len(sent))
        with self.timeline.lock:
            port = self._there(dev_handle)
            size = port.packet(ep)
            for at in range(0, max(1, len(sent)), size):
                if ep in port.halted_out:
                    raise fail(errno.EPIPE)
                port.device.on_bulk_out(ep, sent[at : at + size])
            self.timeline.changed()
            if port.gone:
                raise fail(errno.ENODEV)
        return len(sent)

    def bulk_read(self, dev_handle: _Handle, ep: int, intf: int, buff: "array[int]", timeout: int) -> int:
        """Fill the buffer up to its end or a short packet; a short count if time runs out on the way."""
        count = self._fill(dev_handle, ep, memoryview(buff).cast("B"), timeout)
        self._spend(dev_handle, count)
        return count

    intr_write, intr_read = bulk_write, bulk_read

    def ctrl_transfer(
        self,
        dev_handle: _Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: "array[int]",
        timeout: int,
    ) -> int:
        """Run a control transfer; unknown requests stall, and that stall clears itself."""
        self._spend(dev_handle, 0)
        setup = Setup(bmRequestType, bRequest, wValue, wIndex, len(data))
        with self.timeline.lock:
            port = self._there(dev_handle)
            to_host = bool(bmRequestType & 0x80)
            try:
                answer = control(port, setup, b"" if to_host else data.tobytes())
            except Stall:
                raise fail(errno.EPIPE) from None
            self.timeline.changed()
            if not to_host:
                return len(data)
            answer = answer[: len(data)]
            memoryview(data).cast("B")[: len(answer)] = answer
            return len(answer)

    def clear_halt(self, dev_handle: _Handle, ep: int) -> None:
        """Let an endpoint go on."""
        with self.timeline.lock:
            self._there(dev_handle).clear_halt(ep)

    def reset_device(self, dev_handle: _Handle) -> None:
        """Empty the queues, clear the halts and reset the device; it keeps its address."""
        with self.timeline.lock:
            self._there(dev_handle).reset()

    def _fill(self, handle: _Handle, endpoint: int, buffer: memoryview, timeout: int) -> int:
        timeline, port = self.timeline, handle.port
        with timeline.lock:
            queue = self._there(handle).queue(endpoint)
        deadline = math.inf if timeout == 0 else timeline.now() + timeout / 1000
        filled = 0
        while True:
            with timeline.lock:
                self._there(handle)
                if queue.halted:
                    raise fail(errno.EPIPE)
                try:
                    count, done = queue.take(buffer[filled:])
                except Overflow:
                    raise fail(errno.EOVERFLOW) from None
                filled += count
                if not port.spend(count):
                    raise fail(errno.ENODEV)
            if done:
                return filled
            if not timeline.wait(lambda: bool(queue) or queue.halted or port.gone, deadline - timeline.now()):
                if filled:
                    return filled
                raise fail(errno.ETIMEDOUT)

    def _spend(self, handle: _Handle, count: int) -> None:
        """Let the time pass that a transfer of `count` bytes takes."""
        fast = self._there(handle).device.description.speed >= SUPER_SPEED
        self.timeline.sleep(_MICROFRAME + count / (self._bandwidth or _RATE[fast]))

    def _there(self, handle: _Handle) -> Port:
        if handle.port.gone:
            raise fail(errno.ENODEV)
        return handle.port

    def _holder(self, port: Port) -> Holder:
        return self._holders.get(port.device.description.serial, Holder.NOBODY)
