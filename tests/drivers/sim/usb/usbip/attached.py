"""The devices of a USB/IP server as a pyusb backend: what vhci-hcd and libusb make of them, over TCP."""

import errno
from array import array
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import usb.backend
from usb.core import USBError, USBTimeoutError

from .host import AttachedDevice, Wire, bus_ids


class AttachedBus(usb.backend.IBackend):  # type: ignore[misc]
    """The devices of a server, attached when it is made."""

    def __init__(self, address: tuple[str, int], wires: list[Wire] | None = None) -> None:
        super().__init__()
        self.devices = [AttachedDevice(address, bus_id, wires) for bus_id in bus_ids(address, wires)]

    def detach(self) -> None:
        for device in self.devices:
            device.close()

    def enumerate_devices(self) -> Iterator[AttachedDevice]:
        return iter([device for device in self.devices if not device.gone])

    def get_parent(self, dev: AttachedDevice) -> None:
        return None

    def get_device_descriptor(self, dev: AttachedDevice) -> SimpleNamespace:
        place = {"bus": dev.bus, "address": dev.address, "port_number": 1, "port_numbers": (1,)}
        return SimpleNamespace(**vars(dev.device), **place, speed=dev.speed)

    def get_configuration_descriptor(self, dev: AttachedDevice, config: int) -> SimpleNamespace:
        return [dev.configuration][config]

    def get_interface_descriptor(self, dev: AttachedDevice, intf: int, alt: int, config: int) -> Any:
        return [dev.interfaces[number] for number in sorted(dev.interfaces)][intf][alt]

    def get_endpoint_descriptor(self, dev: AttachedDevice, ep: int, intf: int, alt: int, config: int) -> Any:
        return self.get_interface_descriptor(dev, intf, alt, config).endpoints[ep]

    def open_device(self, dev: AttachedDevice) -> AttachedDevice:
        return dev

    def close_device(self, dev_handle: AttachedDevice) -> None:
        pass

    def get_configuration(self, dev_handle: AttachedDevice) -> int:
        return int(self._done(dev_handle.control(0x80, 8, 0, 0, 1))[0])

    def claim_interface(self, dev_handle: AttachedDevice, intf: int) -> None:
        pass

    def release_interface(self, dev_handle: AttachedDevice, intf: int) -> None:
        pass

    def bulk_write(
        self, dev_handle: AttachedDevice, ep: int, intf: int, data: "array[int]", timeout: int
    ) -> int:
        return len(self._done(dev_handle.transfer(ep, data.tobytes(), timeout / 1000)))

    def bulk_read(
        self, dev_handle: AttachedDevice, ep: int, intf: int, buff: "array[int]", timeout: int
    ) -> int:
        data = self._done(dev_handle.transfer(ep, len(buff), timeout / 1000))
        memoryview(buff).cast("B")[: len(data)] = data
        return len(data)

    intr_read, intr_write = bulk_read, bulk_write

    def ctrl_transfer(
        self,
        dev_handle: AttachedDevice,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: "array[int]",
        timeout: int,
    ) -> int:
        asked = len(data) if bmRequestType & 0x80 else data.tobytes()
        answer = self._done(dev_handle.control(bmRequestType, bRequest, wValue, wIndex, asked))
        if bmRequestType & 0x80:
            memoryview(data).cast("B")[: len(answer)] = answer
        return len(answer)

    def clear_halt(self, dev_handle: AttachedDevice, ep: int) -> None:
        self._done(dev_handle.control(0x02, 1, 0, ep, b""))

    def _done(self, done: tuple[int, bytes] | None) -> bytes:
        if done is None:
            raise USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        status, data = done
        if status:
            raise USBError("Transfer failed", None, -status)
        return data
