"""The bootstrap registers of a GigE Vision device, and where its GenICam XML is found."""

from contextlib import suppress
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.archive import LARGEST_XML, parse_url, unzipped
from drivers.genicam.external_description import read_url
from imaging.and_list import and_list

URL_SIZE = 512
DISCOVERY_SIZE = 0xF8
"""Bytes of the registers that DISCOVERY answers with."""


class Bootstrap(IntEnum):
    """Addresses, as in Wireshark's dissector; what is not 4 bytes long says so."""

    VERSION = 0x0000
    MAC_HIGH = 0x0008
    MAC_LOW = 0x000C
    IP = 0x0024
    MANUFACTURER = 0x0048
    """32 bytes."""
    MODEL = 0x0068
    """32 bytes."""
    DEVICE_VERSION = 0x0088
    """32 bytes."""
    SERIAL = 0x00D8
    """16 bytes."""
    USER_NAME = 0x00E8
    """16 bytes."""
    FIRST_URL = 0x0200
    SECOND_URL = 0x0400
    INTERFACES = 0x0600
    STREAMS = 0x0904
    ACTIONS = 0x0908
    ACTION_DEVICE_KEY = 0x090C
    CAPABILITY = 0x0934
    HEARTBEAT_TIMEOUT = 0x0938
    """ms"""
    TICK_FREQUENCY = 0x093C
    """8 bytes; Hz of the clock, ns where it is synchronised by IEEE 1588."""
    TIMESTAMP_CONTROL = 0x0944
    TIMESTAMP = 0x0948
    """8 bytes."""
    IEEE_1588_STATUS = 0x096C
    CONTROL_PRIVILEGE = 0x0A00
    STREAM_PORT = 0x0D00
    STREAM_PACKET_SIZE = 0x0D04
    STREAM_PACKET_DELAY = 0x0D08
    STREAM_DESTINATION = 0x0D18
    STREAM_SOURCE_PORT = 0x0D1C
    ACTION_GROUP_KEY = 0x9800
    ACTION_GROUP_MASK = 0x9804
    """Mask of action 0; those of the next are 16 bytes further."""


CAN_RESEND, CAN_SCHEDULE = 1 << 2, 1 << 17
"""Bits of CAPABILITY: packets are sent again; action commands may name a time."""
NANOSECONDS = 1_000_000_000
"""The TICK_FREQUENCY of a clock that is synchronised by IEEE 1588."""
EXCLUSIVE, CONTROL = 1, 2
"""Bits of CONTROL_PRIVILEGE."""
LATCH = 2
"""The bit of TIMESTAMP_CONTROL that keeps what the clock shows."""
FIRE_TEST, DO_NOT_FRAGMENT = 1 << 31, 1 << 30
"""Bits of STREAM_PACKET_SIZE, whose lowest 16 are the size."""


class Registers(Protocol):
    """The memory of a device."""

    where: str

    def read(self, address: int, size: int) -> bytes:
        """`size` bytes."""
        ...

    def read_number(self, address: int, size: int) -> int:
        """An unsigned number, big endian."""
        ...

    def write_number(self, address: int, size: int, value: int) -> None:
        """An unsigned number, big endian."""
        ...


class BootstrapClock:
    """The timestamp registers. Errors are those of the control channel."""

    def __init__(self, control: Registers) -> None:
        self._control = control

    def latch(self) -> None:
        """Keep what the clock shows now."""
        self._control.write_number(Bootstrap.TIMESTAMP_CONTROL, 4, LATCH)

    def latched(self) -> int:
        """Return what was kept."""
        return self._control.read_number(Bootstrap.TIMESTAMP, 8)


@dataclass(frozen=True)
class About:
    """Device description in a discovery answer. serial: its MAC address if it states none."""

    address: str
    serial: str
    make: str
    model: str

    @classmethod
    def parse(cls, data: bytes, address: str) -> "About":
        """Parse an answer to DISCOVERY that came from `address`. CameraProtocol if it is too short."""
        if len(data) < DISCOVERY_SIZE:
            raise CameraProtocol(f"{address} describes itself in {len(data)} bytes")
        mac = data[Bootstrap.MAC_HIGH + 2 : Bootstrap.MAC_LOW + 4].hex(":")
        serial = _text(data[Bootstrap.SERIAL : Bootstrap.SERIAL + 16])
        make = _text(data[Bootstrap.MANUFACTURER : Bootstrap.MANUFACTURER + 32])
        model = _text(data[Bootstrap.MODEL : Bootstrap.MODEL + 32])
        return cls(address, serial or mac, make, model)


def _text(data: bytes) -> str:
    return data.split(b"\0")[0].decode("utf-8", "replace").strip()


def read_xml(control: Registers, address: str) -> bytes:
    """The GenICam XML, unzipped: in the device, else where its URLs lead; by http to the device alone.

    address: of the device, IPv4. CameraProtocol: it is damaged, or nowhere. CameraRefused: as `read_url`.
    """
    urls = [_text(control.read(url, URL_SIZE)) for url in (Bootstrap.FIRST_URL, Bootstrap.SECOND_URL)]
    place = next((place for place in map(parse_url, urls) if place is not None), None)
    if place is None:
        elsewhere = [url for url in urls if url.lower().startswith(("file:", "http:"))]
        for other in elsewhere[:-1]:
            with suppress(CameraRefused):
                return read_url(other, control.where, address)
        if elsewhere:
            return read_url(elsewhere[-1], control.where, address)
        places = and_list(repr(url) for url in urls if url) or "nowhere"
        raise CameraProtocol(
            f"{control.where} does not say where its description is ({places}): update the camera's firmware."
        )
    name, begin, size = place
    if not 0 < size <= LARGEST_XML or begin + size > 1 << 32:
        raise CameraProtocol(
            f"{control.where}: its description has {size} bytes: update the camera's firmware."
        )
    data = control.read(begin, size)
    if not name.lower().endswith(".zip") and not data.startswith(b"PK"):
        return data.rstrip(b"\0")
    try:
        return unzipped(data)
    except CameraProtocol as error:
        raise CameraProtocol(f"{control.where}: {error}: update the camera's firmware.") from error
