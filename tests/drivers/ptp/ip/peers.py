"""Cameras on loopback that say on the two connections of PTP/IP whatever a test wants them to."""

import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from drivers.ptp.ip.packets import PacketType

Answer = Callable[[int, int], bytes]
"""Bytes on the command connection for an operation and its transaction."""


def packet(kind: int, fields: bytes = b"") -> bytes:
    return struct.pack("<II", 8 + len(fields), kind) + fields


def response(transaction: int, code: int = 0x2001, *parameters: int) -> bytes:
    fields = struct.pack(f"<HI{len(parameters)}I", code, transaction, *parameters)
    return packet(PacketType.RESPONSE, fields)


def data(transaction: int, *pieces: bytes, length: int | None = None) -> bytes:
    """The packets of a data phase, each piece in one of its own."""
    size = sum(map(len, pieces)) if length is None else length
    head = struct.pack("<I", transaction)
    packets = [packet(PacketType.START_DATA, head + struct.pack("<Q", size))]
    packets += [packet(PacketType.DATA, head + piece) for piece in pieces[:-1]]
    return b"".join([*packets, packet(PacketType.END_DATA, head + pieces[-1])])


class Peer:
    """Accepts both connections and answers operations by `answer`, cancels by `on_cancel`.

    init, init_events: what it answers to the two introductions. hangs_up: after the first answer. received:
    packets, by the connection.
    """

    def __init__(self, answer: Answer | None = None) -> None:
        self.answer: Answer = answer or (lambda operation, transaction: response(transaction))
        self.on_cancel: Answer | None = None
        self.hangs_up = False
        self.init = packet(PacketType.INIT_COMMAND_ACK, struct.pack("<I", 7) + bytes(16) + b"\0\0\0\0\1\0")
        self.init_events = packet(PacketType.INIT_EVENT_ACK)
        self.received: list[tuple[str, int, bytes]] = []
        self.came = threading.Condition()
        self.events: socket.socket | None = None
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.host, self.port = self._listening.getsockname()
        self._links: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def close(self) -> None:
        for link in (self._listening, *self._links):
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for thread in self._threads:
            thread.join()

    def hang_up(self) -> None:
        """On everybody who is connected."""
        for link in self._links:
            link.shutdown(socket.SHUT_RDWR)

    def wait_for(self, kind: int) -> bytes:
        """The fields of the first packet of a type that came, or comes."""
        with self.came:
            assert self.came.wait_for(lambda: any(one[1] == kind for one in self.received), 5.0)
            return next(fields for _, came, fields in self.received if came == kind)

    def _accept(self) -> None:
        while True:
            try:
                link, _ = self._listening.accept()
            except OSError:
                return
            self._links.append(link)
            thread = threading.Thread(target=self._serve, args=(link,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _serve(self, link: socket.socket) -> None:
        try:
            while True:
                length, kind = struct.unpack("<II", self._exactly(link, 8))
                fields = self._exactly(link, length - 8)
                if kind == PacketType.INIT_EVENT_REQUEST:
                    self.events = link
                with self.came:
                    self.received.append(("events" if link is self.events else "commands", kind, fields))
                    self.came.notify_all()
                if kind == PacketType.INIT_COMMAND_REQUEST:
                    link.sendall(self.init)
                elif kind == PacketType.INIT_EVENT_REQUEST:
                    link.sendall(self.init_events)
                elif kind == PacketType.OPERATION_REQUEST:
                    phase, operation, transaction = struct.unpack_from("<IHI", fields)
                    self._commands, self._pending = link, (operation, transaction)
                    if phase == 1:
                        link.sendall(self.answer(operation, transaction))
                        if self.hangs_up:
                            return
                elif kind == PacketType.END_DATA:
                    link.sendall(self.answer(*self._pending))
                elif kind == PacketType.CANCEL and self.on_cancel is not None:
                    self._commands.sendall(self.on_cancel(0, *struct.unpack("<I", fields)))
        except (OSError, EOFError):
            return
        finally:
            link.close()

    @staticmethod
    def _exactly(link: socket.socket, size: int) -> bytes:
        got = b""
        while len(got) < size:
            piece = link.recv(size - len(got))
            if not piece:
                raise EOFError
            got += piece
        return got


@contextmanager
def peer(answer: Answer | None = None) -> Iterator[Peer]:
    """One, closed in the end."""
    there = Peer(answer)
    try:
        yield there
    finally:
        there.close()
