"""Where a camera on the network is, as people write it: `gige:192.168.1.20`."""

from ipaddress import IPv4Address
from typing import Any

SCHEME = "gige:"


def address_of(value: Any) -> str:
    """The IPv4 address. ValueError says what has to be written instead."""
    try:
        if not isinstance(value, str) or not value.startswith(SCHEME):
            raise ValueError
        return str(IPv4Address(value.removeprefix(SCHEME)))
    except ValueError:
        raise ValueError('gige: and an IPv4 address, as "gige:192.168.1.20"') from None
