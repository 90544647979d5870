"""Descriptors of a virtual USB device, as pyusb reads them and as the device sends them."""

import struct
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Literal

HIGH_SPEED, SUPER_SPEED = 3, 4
"""Speed codes of libusb."""

_ENGLISH = 0x0409
_TYPES = {"bulk": 2, "interrupt": 3}
_LAYOUTS = {1: "<BBHBBBBHHHBBBB", 2: "<BBHBBBBB", 4: "<9B", 5: "<BBBBHB"}
"""Layouts of descriptors by their type: device, configuration, interface, endpoint."""
_CAPABILITIES = struct.pack(
    "<BBHB BBBI BBBBHBBH",
    *(5, 15, 22, 2),
    *(7, 16, 2, 2),  # USB 2.0 extension: LPM, as it must be
    *(10, 16, 3, 0, 1 << 3, 3, 0, 0),  # SuperSpeed, which all of it needs
)
"""The capabilities of every SuperSpeed device (BOS)."""


@dataclass(frozen=True)
class Endpoint:
    """address: bit 7 set towards the host; packet: wMaxPacketSize, bytes."""

    address: int
    kind: Literal["bulk", "interrupt"]
    packet: int


@dataclass(frozen=True)
class Interface:
    """One alternate setting of an interface; `code` is class, subclass, protocol."""

    number: int
    code: tuple[int, int, int]
    endpoints: tuple[Endpoint, ...]
    alternate: int = 0
    extra: bytes = b""
    """Class-specific descriptors after it."""


@dataclass(frozen=True)
class Description:
    """A device with one configuration. strings: manufacturer, product, serial, then any others, from 1.

    function: class, subclass and protocol of all its interfaces together, if they are one function.
    """

    vendor: int
    product: int
    strings: tuple[str, ...]
    interfaces: tuple[Interface, ...]
    code: tuple[int, int, int] = (0, 0, 0)
    speed: int = HIGH_SPEED
    function: tuple[int, int, int] | None = None

    @property
    def serial(self) -> str:
        """The third string: who the device is."""
        return self.strings[2]

    def numbers(self) -> tuple[int, ...]:
        """The interfaces' numbers, each once, ascending."""
        return tuple(sorted({interface.number for interface in self.interfaces}))

    def alternates(self, number: int) -> tuple[Interface, ...]:
        """The alternate settings of an interface."""
        return tuple(interface for interface in self.interfaces if interface.number == number)

    def endpoints(self) -> frozenset[int]:
        """The addresses of all endpoints."""
        return frozenset(one.address for interface in self.interfaces for one in interface.endpoints)

    def string(self, index: int) -> bytes | None:
        """A string descriptor, or None for an unknown index."""
        if index > len(self.strings):
            return None
        body = struct.pack("<H", _ENGLISH) if index == 0 else self.strings[index - 1].encode("utf-16-le")
        return bytes((2 + len(body), 3)) + body

    def sent(self, kind: int, index: int) -> bytes | None:
        """A descriptor as the device sends it, by its type and index; None for one that it does not have."""
        if kind == 3:
            return self.string(index)
        if (kind, index) == (1, 0):
            return _encoded(device_descriptor(self, 0, 0))
        if (kind, index) == (2, 0):
            return _encoded(configuration_descriptor(self)) + self._inside()
        if (kind, index) == (15, 0) and self.speed >= SUPER_SPEED:
            return _CAPABILITIES
        return None

    def _inside(self) -> bytes:
        """The descriptors of interfaces and endpoints."""
        sent = b""
        for place, number in enumerate(self.numbers()):
            for alternate, interface in enumerate(self.alternates(number)):
                sent += _encoded(interface_descriptor(self, place, alternate))
                for endpoint in range(len(interface.endpoints)):
                    sent += _encoded(endpoint_descriptor(self, endpoint, place, alternate))
        return sent


def _encoded(descriptor: SimpleNamespace) -> bytes:
    """The bytes of a descriptor, and of those that come with it."""
    layout = struct.Struct(_LAYOUTS[descriptor.bDescriptorType])
    count = len(layout.unpack(bytes(layout.size)))
    extra = bytes(getattr(descriptor, "extra_descriptors", ()))
    return layout.pack(*list(vars(descriptor).values())[:count]) + extra


def device_descriptor(description: Description, bus: int, address: int) -> SimpleNamespace:
    """The fields that pyusb copies; all of the device, where it is plugged in included."""
    big = description.speed >= SUPER_SPEED
    return SimpleNamespace(
        bLength=18,
        bDescriptorType=1,
        bcdUSB=0x0300 if big else 0x0200,
        bDeviceClass=description.code[0],
        bDeviceSubClass=description.code[1],
        bDeviceProtocol=description.code[2],
        bMaxPacketSize0=9 if big else 64,
        idVendor=description.vendor,
        idProduct=description.product,
        bcdDevice=0x0100,
        iManufacturer=1,
        iProduct=2,
        iSerialNumber=3,
        bNumConfigurations=1,
        bus=bus,
        address=address,
        port_number=address,
        port_numbers=(address,),
        speed=description.speed,
    )


def configuration_descriptor(description: Description) -> SimpleNamespace:
    """The one configuration; its total length counts every descriptor inside."""
    numbers = description.numbers()
    association = b""
    if description.function is not None:
        association = bytes((8, 11, numbers[0], len(numbers), *description.function, 0))
    return SimpleNamespace(
        bLength=9,
        bDescriptorType=2,
        wTotalLength=9 + len(association) + len(description._inside()),
        bNumInterfaces=len(numbers),
        bConfigurationValue=1,
        iConfiguration=0,
        bmAttributes=0xC0,
        bMaxPower=1,
        extra_descriptors=list(association),
    )


def interface_descriptor(description: Description, index: int, alternate: int) -> SimpleNamespace:
    """An alternate setting of an interface. IndexError past the last, which ends pyusb's iteration."""
    interface = description.alternates(description.numbers()[index])[alternate]
    return SimpleNamespace(
        bLength=9,
        bDescriptorType=4,
        bInterfaceNumber=interface.number,
        bAlternateSetting=interface.alternate,
        bNumEndpoints=len(interface.endpoints),
        bInterfaceClass=interface.code[0],
        bInterfaceSubClass=interface.code[1],
        bInterfaceProtocol=interface.code[2],
        iInterface=0,
        extra_descriptors=list(interface.extra),
    )


def endpoint_descriptor(
    description: Description, endpoint: int, index: int, alternate: int
) -> SimpleNamespace:
    """An endpoint of an alternate setting. IndexError past the last."""
    interface_endpoint = description.alternates(description.numbers()[index])[alternate].endpoints[endpoint]
    interrupt = interface_endpoint.kind == "interrupt"
    per_interval = interface_endpoint.packet if interrupt else 0
    companion = struct.pack("<BBBBH", 6, 48, 0, 0, per_interval)
    return SimpleNamespace(
        bLength=7,
        bDescriptorType=5,
        bEndpointAddress=interface_endpoint.address,
        bmAttributes=_TYPES[interface_endpoint.kind],
        wMaxPacketSize=interface_endpoint.packet,
        bInterval=4 if interrupt else 0,
        bRefresh=0,
        bSynchAddress=0,
        extra_descriptors=list(companion if description.speed >= SUPER_SPEED else b""),
    )
