"""Descriptors of a virtual USB device, as pyusb reads them."""

import struct
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Literal

HIGH_SPEED, SUPER_SPEED = 3, 4
"""Speed codes of libusb."""

_ENGLISH = 0x0409
_TYPES = {"bulk": 2, "interrupt": 3}


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
    """A device with one configuration. strings: manufacturer, product, serial, then any others, from 1."""

    vendor: int
    product: int
    strings: tuple[str, ...]
    interfaces: tuple[Interface, ...]
    code: tuple[int, int, int] = (0, 0, 0)
    speed: int = HIGH_SPEED

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

    def string(self, index: int) -> bytes | None:
        """A string descriptor, or None for an unknown index."""
        if index > len(self.strings):
            return None
        body = struct.pack("<H", _ENGLISH) if index == 0 else self.strings[index - 1].encode("utf-16-le")
        return bytes((2 + len(body), 3)) + body


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
    inside = sum(
        9 + len(interface.extra) + 7 * len(interface.endpoints) for interface in description.interfaces
    )
    return SimpleNamespace(
        bLength=9,
        bDescriptorType=2,
        wTotalLength=9 + inside,
        bNumInterfaces=len(description.numbers()),
        bConfigurationValue=1,
        iConfiguration=0,
        bmAttributes=0xC0,
        bMaxPower=1,
        extra_descriptors=[],
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
    return SimpleNamespace(
        bLength=7,
        bDescriptorType=5,
        bEndpointAddress=interface_endpoint.address,
        bmAttributes=_TYPES[interface_endpoint.kind],
        wMaxPacketSize=interface_endpoint.packet,
        bInterval=4 if interface_endpoint.kind == "interrupt" else 0,
        bRefresh=0,
        bSynchAddress=0,
        extra_descriptors=[],
    )
