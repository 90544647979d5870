"""A device that is opened through a producer: its registers, its description, its stream."""

import ctypes
from contextlib import suppress

from drivers.clock import Clock
from drivers.errors import CameraNotFound, CameraProtocol, CameraRefused
from drivers.genicam.archive import LARGEST_XML, parse_url, unzipped
from drivers.genicam.chunks import ByteOrder
from drivers.genicam.external_description import read_url
from drivers.genicam.nodemap import NodeMap
from drivers.gentl.abi import CONTROL, Library
from drivers.gentl.producer import ListedCamera, Producer
from drivers.gentl.stream import GentlStream
from imaging.errors import CameraError

_ORDERS: dict[str, ByteOrder] = {"GEV": "big", "U3V": "little"}
"""Byte orders of the tags between chunks, by transport."""
_AT_ONCE = 1 << 16
"""Bytes that are read in one call."""


class Port:
    """The registers of a device, as `drivers.genicam.nodemap.Memory` has them."""

    def __init__(self, library: Library, handle: int, where: str) -> None:
        self._library, self._handle, self._where = library, handle, where

    def read(self, address: int, size: int) -> bytes:
        """`size` bytes from `address`."""
        parts = []
        for begin in range(0, size, _AT_ONCE):
            count = min(_AT_ONCE, size - begin)
            data, got = ctypes.create_string_buffer(count), ctypes.c_size_t(count)
            place = self._handle, address + begin, data, ctypes.byref(got)
            self._library.call("GCReadPort", *place, where=self._where)
            if got.value != count:
                raise CameraProtocol(f"{self._where}: {got.value} of {count} bytes came: plug it in again.")
            parts.append(data.raw)
        return b"".join(parts)

    def write(self, address: int, data: bytes) -> None:
        """Write `data` to `address`."""
        size = ctypes.c_size_t(len(data))
        place = self._handle, address, ctypes.create_string_buffer(data, len(data)), ctypes.byref(size)
        self._library.call("GCWritePort", *place, where=self._where)


class NoClock:
    """Registers of a device's clock: GenTL has none; its features are asked."""

    def latch(self) -> None:
        """CameraRefused."""
        raise CameraRefused("GenTL shows no clock: ask the camera's features.")

    def latched(self) -> int:
        """CameraRefused."""
        raise CameraRefused("GenTL shows no clock: ask the camera's features.")


class GentlSession:
    """The device from open to close; errors are those of its parts."""

    nodes: NodeMap
    stream: GentlStream
    device_clock = NoClock()

    def __init__(self, entry: ListedCamera) -> None:
        self._library = library = entry.producer.library
        self.make, self.model = entry.make, entry.model
        self.where = f"GenTL {library.where} {entry.device}"
        self.chunk_order = _ORDERS.get(entry.transport, "little")
        self._device = library.handle(
            "IFOpenDevice", entry.interface, entry.device.encode(), CONTROL, where=self.where
        )
        try:
            port = library.handle("DevGetPort", self._device, where=self.where)
            memory = Port(library, port, self.where)
            self.nodes = NodeMap(read_xml(library, port, memory, self.where), memory, self.where)
            name = library.text("DevGetDataStreamID", self._device, 0)
            opened = library.handle("DevOpenDataStream", self._device, name.encode(), where=self.where)
            known = entry.transport in _ORDERS
            self.stream = GentlStream(library, opened, self.nodes, self.where, chunks=known)
        except CameraError:
            self._close_device()
            raise

    def close(self) -> None:
        """Let go of the device; a second time does nothing."""
        if self._device:
            self.stream.close()
            self._close_device()

    def _close_device(self) -> None:
        device, self._device = self._device, 0
        with suppress(CameraError):  # it may have been unplugged
            self._library.call("DevClose", device)


def read_xml(library: Library, port: int, memory: Port, where: str) -> bytes:
    """The GenICam description in the device, unzipped. CameraProtocol: it is damaged, or elsewhere."""
    count = ctypes.c_uint32()
    library.call("GCGetNumPortURLs", port, ctypes.byref(count), where=where)
    urls = [library.info_text("GCGetPortURLInfo", port, at, 0) for at in range(count.value)]
    for url in urls:
        place = parse_url(url)
        if place is not None:
            _, begin, size = place
            if not 0 < size <= LARGEST_XML:
                raise CameraProtocol(f"{where}: its description has {size} bytes: update its firmware.")
            data = memory.read(begin, size)
            if not data.startswith(b"PK"):
                return data.rstrip(b"\0")
            try:
                return unzipped(data)
            except CameraProtocol as error:
                raise CameraProtocol(f"{where}: {error}: update its firmware.") from error
    for url in urls:
        if url.lower().startswith("file:"):
            return read_url(url, where)
    raise CameraProtocol(f"{where}: its description is not in the camera ({urls}): update its firmware.")


def open_session(producer: Producer, serial: str, clock: Clock, patience: float = 0.0) -> GentlSession:
    """Open the device with that serial number; it may take `patience` s to appear. CameraNotFound."""
    deadline = clock.now() + patience
    while True:
        entry = next((one for one in producer.cameras() if one.serial == serial), None)
        if entry is not None:
            return GentlSession(entry)
        if clock.now() >= deadline:
            where = producer.library.where
            raise CameraNotFound(f"{where} reports no camera {serial}: plug it in.")
        clock.sleep(min(0.1, max(deadline - clock.now(), 0.001)))
