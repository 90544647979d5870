"""Node maps over a memory, of a few lines of XML."""

from drivers.genicam.nodemap import NodeMap


class Bytes:
    """Memory that records what is written."""

    def __init__(self) -> None:
        self.data = bytearray(256)
        self.writes: list[tuple[int, bytes]] = []

    def read(self, address: int, size: int) -> bytes:
        return bytes(self.data[address : address + size])

    def write(self, address: int, data: bytes) -> None:
        self.writes.append((address, data))
        self.data[address : address + len(data)] = data


def node_map(inside: str, memory: Bytes | None = None) -> NodeMap:
    xml = f'<g:RegisterDescription xmlns:g="urn:x">{inside}<Port Name="Device"/></g:RegisterDescription>'
    return NodeMap(xml.encode(), memory or Bytes(), "the camera")


def register(kind: str, inside: str, access: str = "RW") -> str:
    common = f"<AccessMode>{access}</AccessMode><pPort>Device</pPort>"
    return f'<{kind} Name="R"><Address>0x10</Address>{common}{inside}</{kind}>'
