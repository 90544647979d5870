"""Packets of USB/IP 1.1.1 (Documentation/usb/usbip_protocol.rst of Linux): bytes in, records out.

All numbers are big endian, but for the 8 bytes of a control transfer's setup, which are as on USB.
"""

import struct
from dataclasses import dataclass

from drivers.sim.usb.descriptors import SUPER_SPEED, Description, device_descriptor
from drivers.sim.usb.port import Setup

PORT = 3240
LIST, IMPORT = 0x8005, 0x8003
"""Requests of a new connection; answers have them without the highest bit."""
DONE, NOT_AVAILABLE, NO_DEVICE = 0, 1, 4
"""Status of their answers, as the tools of Linux have them."""
REQUEST_SIZE, BUS_ID_SIZE, COMMAND_SIZE = 8, 32, 48
SHORT_NOT_OK, ZERO_PACKET = 0x01, 0x40
"""Flags of a transfer: a short read is an error; an empty packet ends a write whose last one is full."""
_VERSION = 0x0111
_SUBMIT, _UNLINK, _SUBMITTED, _UNLINKED = 1, 2, 3, 4
_REQUEST = struct.Struct(">HHI")
_DEVICE = struct.Struct(">256s32sIIIHHH6B")
_COMMAND = struct.Struct(">5I28s")
_TRANSFER = struct.Struct(">IIIII8s")
_SETUP = struct.Struct("<BBHHH")
_SPEEDS = {SUPER_SPEED: 5}
"""Speeds as Linux counts them, where libusb does not."""
_NO_PACKETS = (0, 0xFFFFFFFF)
"""Isochronous packets of a transfer that is not isochronous: clients of Linux send 0."""


@dataclass(frozen=True)
class Submit:
    """A transfer that the client asks for. endpoint: its address; length: bytes that the client has room for
    or sends; packets: of the command, for the answer.
    """

    number: int
    device: int
    endpoint: int
    length: int
    flags: int
    setup: Setup
    packets: int

    @property
    def to_host(self) -> bool:
        """The direction."""
        return bool(self.endpoint & 0x80)


@dataclass(frozen=True)
class Unlink:
    """A command to give up the transfer `of`."""

    number: int
    device: int
    of: int


def request_of(data: bytes) -> int:
    """The code of a request."""
    code: int = _REQUEST.unpack(data)[1]
    return code


def answer(request: int, status: int = DONE) -> bytes:
    """The head of the answer to a request."""
    return _REQUEST.pack(_VERSION, request & 0x7FFF, status)


def exported(bus_id: str, place: tuple[int, int], description: Description) -> bytes:
    """A device as answers describe it. place: its bus and its address."""
    device = device_descriptor(description, *place)
    path = f"/{description.strings[1]}/{description.serial}".encode()[:255]
    return _DEVICE.pack(
        path,
        bus_id.encode(),
        *place,
        _SPEEDS.get(description.speed, description.speed),
        *(device.idVendor, device.idProduct, device.bcdDevice),
        *(*description.code, 1, 1, len(description.numbers())),
    )


def listed(devices: dict[str, tuple[tuple[int, int], Description]]) -> bytes:
    """The answer to LIST: devices by bus id, and what kinds of interface each has."""
    data = answer(LIST) + struct.pack(">I", len(devices))
    for bus_id, (place, description) in devices.items():
        data += exported(bus_id, place, description)
        for number in description.numbers():
            data += bytes((*description.alternates(number)[0].code, 0))
    return data


def command_of(data: bytes) -> Submit | Unlink | None:
    """The command in 48 bytes; None for any that a device without isochronous endpoints refuses."""
    code, number, device, direction, endpoint, rest = _COMMAND.unpack(data)
    if code == _UNLINK:
        return Unlink(number, device, int.from_bytes(rest[:4], "big"))
    flags, length, _, packets, _, setup = _TRANSFER.unpack(rest)
    if code != _SUBMIT or direction > 1 or endpoint > 15 or packets not in _NO_PACKETS:
        return None
    address = endpoint | 0x80 * direction
    return Submit(number, device, address, length, flags, Setup(*_SETUP.unpack(setup)), packets)


def submitted(submit: Submit, status: int, length: int, data: bytes = b"") -> bytes:
    """The answer to a transfer. status: a negative errno or 0; length: bytes that were transferred."""
    head = struct.pack(">5IiIIII8x", _SUBMITTED, submit.number, 0, 0, 0, status, length, 0, submit.packets, 0)
    return head + data


def unlinked(unlink: Unlink, status: int) -> bytes:
    """The answer to an unlink."""
    return struct.pack(">5Ii24x", _UNLINKED, unlink.number, 0, 0, 0, status)
