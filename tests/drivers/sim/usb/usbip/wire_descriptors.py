"""Descriptors that came over a wire, cut and named as libusb gives them."""

import struct
from collections import namedtuple
from types import SimpleNamespace

LAYOUTS = {
    1: (
        "<BBHBBBBHHHBBBB",
        "bLength bDescriptorType bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 "
        "idVendor idProduct bcdDevice iManufacturer iProduct iSerialNumber bNumConfigurations",
    ),
    2: (
        "<BBHBBBBB",
        "bLength bDescriptorType wTotalLength bNumInterfaces bConfigurationValue iConfiguration bmAttributes "
        "bMaxPower",
    ),
    4: (
        "<9B",
        "bLength bDescriptorType bInterfaceNumber bAlternateSetting bNumEndpoints bInterfaceClass "
        "bInterfaceSubClass bInterfaceProtocol iInterface",
    ),
    5: ("<BBBBHB", "bLength bDescriptorType bEndpointAddress bmAttributes wMaxPacketSize bInterval"),
}


def named(data: bytes) -> SimpleNamespace:
    """One descriptor."""
    assert len(data) == data[0] >= 2
    layout, names = LAYOUTS[data[1]]
    fields = namedtuple("Descriptor", names)(*struct.unpack(layout, data))
    return SimpleNamespace(**fields._asdict())


def parsed(data: bytes) -> tuple[SimpleNamespace, dict[int, list[SimpleNamespace]]]:
    """A configuration and its interfaces by number, each with its `endpoints`, as libusb cuts them."""
    configuration, interfaces, last = None, {}, None
    at = 0
    while at < len(data):
        one, kind = data[at : at + data[at]], data[at + 1]
        assert len(one) == data[at] >= 2
        at += data[at]
        if kind not in LAYOUTS:
            last.extra_descriptors += list(one)
            continue
        last = named(one)
        last.extra_descriptors = []
        if kind == 2:
            configuration = last
        elif kind == 4:
            last.endpoints = []
            interfaces.setdefault(last.bInterfaceNumber, []).append(last)
            within = last
        else:
            last.bRefresh = last.bSynchAddress = 0
            within.endpoints.append(last)
    assert configuration is not None
    assert all(len(one.endpoints) == one.bNumEndpoints for many in interfaces.values() for one in many)
    assert len(interfaces) == configuration.bNumInterfaces
    return configuration, interfaces
