"""The committee's own node map, in the package `genicam`."""

from collections.abc import Callable
from typing import Any


def judge_of(
    genapi: Any, xml: str, read: Callable[[int, int], bytes], write: Callable[[int, bytes], None]
) -> tuple[Any, object]:
    """A node map of a description over a memory, and its port, which has to live as long."""

    class Port(genapi.AbstractPort):  # type: ignore[misc]
        def read(self, address: int, length: int) -> bytes:
            return read(address, length)

        def write(self, address: int, data: bytes) -> None:
            write(address, bytes(data))

        def is_open(self) -> bool:
            return True

        def get_access_mode(self) -> int:
            return int(genapi.EAccessMode.RW)

    judge, port = genapi.NodeMap(), Port()
    judge.load_xml_from_string(xml)
    judge.connect(port, "Device")
    return judge, port
