"""A TCP server of simulated cameras: a thread for each connection, and an end to all of them."""

import socket
import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Self


class Refused(Exception):
    """Invalid data from a client, or the end of them; its connection is closed."""


class TcpServer(ABC):
    """Serves each connection in a thread of its own until it is closed."""

    def __init__(self, listening: socket.socket, name: str) -> None:
        """listening: closed with the server. name: of its threads."""
        self._listening, self._name = listening, name
        self.host, self.port = listening.getsockname()[:2]
        self._links: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._links_lock = threading.Lock()
        self._open = True
        self._accepting = threading.Thread(target=self._accept, name=name, daemon=True)
        self._accepting.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Hang up on everybody."""
        with self._links_lock:
            self._open = False
            links, self._links = self._links, set()
        # shutdown, not close alone: it wakes the threads that wait on the sockets.
        for link in (self._listening, *links):
            hang_up(link)
        for thread in (self._accepting, *self._threads):
            thread.join()

    @abstractmethod
    def _serve(self, link: socket.socket) -> None:
        """Serve one connection to its end. Refused, OSError."""

    def _accept(self) -> None:
        while True:
            try:
                link, _ = self._listening.accept()
            except OSError:
                return
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._links_lock:
                if not self._open:
                    hang_up(link)
                    return
                self._links.add(link)
                self._threads = [thread for thread in self._threads if thread.is_alive()]
                thread = threading.Thread(
                    target=self._attend, args=(link,), name=f"{self._name} client", daemon=True
                )
                self._threads.append(thread)
            thread.start()

    def _attend(self, link: socket.socket) -> None:
        try:
            # The client went away or speaks something else: there is no recipient.
            with suppress(Refused, OSError):
                self._serve(link)
        finally:
            with self._links_lock:
                self._links.discard(link)
            hang_up(link)


def exactly(link: socket.socket, size: int) -> bytes:
    """The next bytes, that many. Refused at the end of the connection; OSError."""
    data = bytearray()
    while len(data) < size:
        part = link.recv(size - len(data))
        if not part:
            raise Refused
        data += part
    return bytes(data)


def hang_up(link: socket.socket) -> None:
    """End a connection, and wake the threads that wait on it."""
    with suppress(OSError):  # It was not connected, or is no longer.
        link.shutdown(socket.SHUT_RDWR)
    with suppress(OSError):  # Another thread closes it too.
        link.close()
