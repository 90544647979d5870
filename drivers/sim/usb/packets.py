"""Packets that a device has ready for the host on one endpoint, with their ends and zero-length packets."""

from collections import deque


class Overflow(Exception):
    """The next packet is larger than what is left of the host's buffer; it is lost."""


class PacketQueue:
    """Packets towards the host, as runs: every packet of a run is full but the last, which may be short.

    A run acts exactly as its packets would one by one, and copies as fast as memory does.
    """

    def __init__(self, packet: int) -> None:
        """packet: wMaxPacketSize, bytes."""
        self.packet = packet
        self.halted = False
        self._runs: deque[memoryview] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        """Bytes that wait."""
        return self._bytes

    def __bool__(self) -> bool:
        """Return whether a packet waits, an empty one included."""
        return bool(self._runs)

    def put(self, data: bytes) -> None:
        """Full packets and, if `data` does not fill its last, a short one; b"" is a zero-length packet."""
        self._runs.append(memoryview(data).toreadonly())
        self._bytes += len(data)

    def put_transfer(self, data: bytes) -> None:
        """The packets of a transfer that says where it ends: a zero-length one follows if none is short."""
        self.put(data)
        if data and len(data) % self.packet == 0:
            self.put(b"")

    def clear(self) -> None:
        """Drop everything."""
        self._runs.clear()
        self._bytes = 0

    def take(self, buffer: memoryview) -> tuple[int, bool]:
        """Move packets into the buffer: how many bytes, and whether that ends the host's transfer.

        It ends with a short packet or with a full buffer. Overflow.
        """
        filled = 0
        while self._runs and (filled < len(buffer) or not len(buffer)):
            run, room = self._runs[0], len(buffer) - filled
            # Whole packets that fit; the short packet at the end of the run counts if it fits too.
            size = len(run) if len(run) <= room else room // self.packet * self.packet
            if size == 0 and len(run) > 0:
                self._drop()
                raise Overflow
            buffer[filled : filled + size] = run[:size]
            filled += size
            self._bytes -= size
            if size < len(run):
                self._runs[0] = run[size:]
                continue
            self._runs.popleft()
            if size == 0 or size % self.packet:
                return filled, True
        return filled, filled == len(buffer)

    def _drop(self) -> None:
        """Lose the first packet."""
        first = self._runs.popleft()
        rest = first[self.packet :]
        self._bytes -= len(first) - len(rest)
        if len(rest):
            self._runs.appendleft(rest)
