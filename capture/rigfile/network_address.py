"""Network addresses of cameras as users write them: `gige:192.168.1.20`, `ptpip:192.168.1.2`.

`gphoto2:ptpip:192.168.1.2` has libgphoto2 drive it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import Any, Literal

from drivers.choice import Place
from drivers.gphoto2.library import SCHEME
from drivers.ptp.ip.packets import PORT, place_of

_FORMS = 'gige: or ptpip: and an IPv4 address, as "gige:192.168.1.20" or "ptpip:192.168.1.2"'


@dataclass(frozen=True)
class NetworkAddress:
    """Protocol of a camera, its IPv4 address, and its port where that can be another than the usual one."""

    scheme: Literal["gige", "ptpip", "gphoto2:ptpip"]
    host: str
    port: int | None = None

    def __str__(self) -> str:
        """Format as users write it."""
        return f"{self.scheme}:{self.host}" + ("" if self.port in (None, PORT) else f":{self.port}")

    @property
    def where(self) -> str:
        """Format as its driver does."""
        if self.port is None:
            return f"GigE {self.host}"
        return place_of(self.host, self.port) if self.scheme == "ptpip" else str(self)


def address_of(value: Any) -> NetworkAddress:
    """Return what is written. ValueError says what has to be written instead."""
    try:
        if not isinstance(value, str):
            raise ValueError
        library = value.startswith(SCHEME)
        scheme, _, place = value.removeprefix(SCHEME).partition(":")
        host, colon, port = place.partition(":")
        host = str(IPv4Address(host))
        if scheme == "gige" and not colon and not library:
            return NetworkAddress("gige", host)
        if scheme == "ptpip" and (not colon or (port.isascii() and port.isdigit() and 0 < int(port) < 65536)):
            return NetworkAddress("gphoto2:ptpip" if library else "ptpip", host, int(port) if colon else PORT)
    except ValueError:
        pass
    raise ValueError(_FORMS)


def gige_hosts(addresses: Iterable[NetworkAddress]) -> list[str]:
    """Addresses of the GigE Vision cameras among them."""
    return [address.host for address in addresses if address.port is None]


def ptpip_places(addresses: Iterable[NetworkAddress]) -> list[Place]:
    """Return where the PTP/IP cameras among them are."""
    return [
        Place(address.host, address.port, address.scheme != "ptpip")
        for address in addresses
        if address.port is not None
    ]
