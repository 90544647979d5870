"""A host that attaches a device of a USB/IP server, as vhci-hcd does: its transfers over TCP."""

import errno
import socket
import struct
import threading
from contextlib import suppress
from types import SimpleNamespace

from .wire_descriptors import named, parsed

HEAD, DEVICE = struct.Struct(">HHI"), struct.Struct(">256s32sIIIHHH6B")
PATIENCE = 20.0


class Wire:
    """A connection that keeps what went over it, as (towards the server, bytes), and is listed in `wires`."""

    def __init__(self, address: tuple[str, int], wires: "list[Wire] | None" = None) -> None:
        self.socket = socket.create_connection(address, timeout=PATIENCE)
        self.log: list[tuple[bool, bytes]] = []
        if wires is not None:
            wires.append(self)

    def send(self, data: bytes) -> None:
        self.log.append((True, data))
        self.socket.sendall(data)

    def receive(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            part = self.socket.recv(size - len(data))
            if not part:
                raise ConnectionError("the server hung up")
            data += part
        self.log.append((False, data))
        return data

    def close(self) -> None:
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()


def bus_ids(address: tuple[str, int], wires: list[Wire] | None = None) -> dict[str, list[bytes]]:
    """What a server lists: the kinds of interface by bus id."""
    wire = Wire(address, wires)
    wire.send(HEAD.pack(0x0111, 0x8005, 0))
    assert HEAD.unpack(wire.receive(8)) == (0x0111, 5, 0)
    (count,) = struct.unpack(">I", wire.receive(4))
    kinds = {}
    for _ in range(count):
        fields = DEVICE.unpack(wire.receive(DEVICE.size))
        kinds[fields[1].rstrip(b"\0").decode()] = [wire.receive(4) for _ in range(fields[-1])]
    assert wire.socket.recv(1) == b""
    wire.close()
    return kinds


class Refused(Exception):
    """The server's status, where it does not let a device be attached."""


class AttachedDevice:
    """A device as the host has it: its transfers, each waited for by its number."""

    def __init__(self, address: tuple[str, int], bus_id: str, wires: list[Wire] | None = None) -> None:
        self.wire = Wire(address, wires)
        self.wire.send(HEAD.pack(0x0111, 0x8003, 0) + bus_id.encode().ljust(32, b"\0"))
        status = HEAD.unpack(self.wire.receive(8))[2]
        if status:
            self.wire.close()
            raise Refused(status)
        fields = DEVICE.unpack(self.wire.receive(DEVICE.size))
        assert fields[1].rstrip(b"\0").decode() == bus_id
        self.bus, self.address, self.speed = fields[2:5]
        self.answers: dict[int, tuple[int, bytes]] = {}
        self.sizes: dict[int, int | None] = {}
        self.number, self.gone = 0, False
        self.changed = threading.Condition()
        self.listening = threading.Thread(target=self._listen, daemon=True)
        self.listening.start()
        self.device, head = self._descriptor(1, 18), self._descriptor(2, 9)
        self.sent = self.control(0x80, 6, 2 << 8, 0, head.wTotalLength)[1]
        assert len(self.sent) == head.wTotalLength
        self.configuration, self.interfaces = parsed(self.sent)
        assert self.control(0x00, 9, 1, 0, b"")[0] == 0

    def close(self) -> None:
        self.wire.close()
        self.listening.join()

    def _listen(self) -> None:
        try:
            self.wire.socket.settimeout(None)
            while True:
                data = self.wire.receive(48)
                code, number, *rest, status = struct.unpack(">5Ii", data[:24])
                assert code in (3, 4)
                assert rest == [0, 0, 0]
                length = int.from_bytes(data[24:28], "big") if code == 3 else 0
                payload = self.wire.receive(length) if length and self.sizes[number] is not None else b""
                with self.changed:
                    self.answers[number] = status, payload or bytes(length)
                    self.changed.notify_all()
        except OSError:
            with self.changed:
                self.gone = True
                self.changed.notify_all()

    def begin(self, endpoint: int, asked: int | bytes, setup: bytes = bytes(8), flags: int = 0) -> int:
        """Submit a transfer: to the host if `asked` is its room."""
        with self.changed:
            self.number += 1
            number = self.number
            into_host = isinstance(asked, int)
            self.sizes[number] = asked if into_host else None
            length = asked if into_host else len(asked)
            head = (1, number, self.bus << 16 | self.address, int(into_host), endpoint & 0x0F)
            self.wire.send(
                struct.pack(">10I", *head, flags, length, 0, 0, 0) + setup + (b"" if into_host else asked)
            )
        return number

    def result(self, number: int, timeout: float | None = None) -> tuple[int, bytes] | None:
        """Status and data of a transfer; None if it was given up after `timeout` s."""
        with self.changed:
            came = self.changed.wait_for(lambda: number in self.answers or self.gone, timeout or PATIENCE)
            if not came and timeout is not None:
                unlinked = self.unlink(number)
                if unlinked == -errno.ECONNRESET:
                    assert number not in self.answers
                    return None
                # Too late: the answer came first.
                assert unlinked == 0
            if number in self.answers:
                return self.answers.pop(number)
            assert self.gone, "no answer"
            return -errno.ENODEV, b""

    def unlink(self, number: int) -> int:
        """The status of giving up a transfer."""
        with self.changed:
            self.number += 1
            mine = self.number
            head = struct.pack(">6I24x", 2, mine, self.bus << 16 | self.address, 0, 0, number)
            with suppress(OSError):
                self.wire.send(head)
            assert self.changed.wait_for(lambda: mine in self.answers or self.gone, PATIENCE)
            return self.answers.pop(mine, (0, b""))[0]

    def transfer(
        self, endpoint: int, asked: int | bytes, timeout: float | None = None
    ) -> tuple[int, bytes] | None:
        try:
            return self.result(self.begin(endpoint, asked), timeout)
        except OSError:
            return -errno.ENODEV, b""

    def control(
        self, kind: int, request: int, value: int, index: int, asked: int | bytes
    ) -> tuple[int, bytes]:
        length = asked if isinstance(asked, int) else len(asked)
        try:
            number = self.begin(0, asked, struct.pack("<BBHHH", kind, request, value, index, length))
            done = self.result(number)
        except OSError:
            return -errno.ENODEV, b""
        assert done is not None
        return done

    def _descriptor(self, kind: int, size: int) -> SimpleNamespace:
        status, data = self.control(0x80, 6, kind << 8, 0, size)
        assert (status, len(data), data[1]) == (0, size, kind)
        return named(data)
