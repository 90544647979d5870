"""The transfers of a client that a device is attached to: done at once, or as soon as the device has data."""

import errno
from dataclasses import dataclass, field

from drivers.sim.usb.packets import Overflow
from drivers.sim.usb.port import Port, Stall
from drivers.sim.usb.requests import control
from drivers.sim.usb.usbip.packets import SHORT_NOT_OK, ZERO_PACKET, Submit, Unlink, submitted, unlinked

_MOST_READS = 4096
"""Reads that may wait at a time."""


@dataclass
class _Read:
    """A read that waits, and what has come."""

    submit: Submit
    data: bytearray = field(default_factory=bytearray)


class Transfers:
    """All methods are called with the timeline's lock held. over: set by the client's end.

    What a client is answered is in one queue: an unlink that comes too late must be answered after the
    transfer that it meant.
    """

    def __init__(self, port: Port) -> None:
        self.port, self.over = port, False
        self.backlog = 0
        """Bytes of answers that were not taken yet."""
        self._reads: dict[int, _Read] = {}
        """Reads by their number, in the order in which they came."""
        self._answers: list[bytes] = []
        self._endpoints = port.device.description.endpoints()

    def submit(self, submit: Submit, data: bytes) -> None:
        """Begin a transfer; data: those to the device."""
        if submit.endpoint & 0x7F == 0:
            self._control(submit, data)
        elif submit.endpoint not in self._endpoints:
            self._answer(submitted(submit, -errno.EPIPE, 0))
        elif not submit.to_host:
            self._write(submit, data)
        elif len(self._reads) < _MOST_READS:
            self._reads[submit.number] = _Read(submit)
        else:
            self._answer(submitted(submit, -errno.ENOMEM, 0))
        self.port.timeline.changed()

    def unlink(self, unlink: Unlink) -> None:
        """Give up a read; what had come of it is lost. Other transfers are over by then."""
        read = self._reads.pop(unlink.of, None)
        self._answer(unlinked(unlink, 0 if read is None else -errno.ECONNRESET))
        self.port.timeline.changed()

    def ready(self) -> bool:
        """Return whether `take` has something, or there is nothing more to wait for."""
        return (
            self.over or self.port.gone or bool(self._answers) or any(map(self._moves, self._reads.values()))
        )

    def take(self) -> bytes:
        """Let the device's data go into the reads that wait, and return the answers."""
        for read in [*self._reads.values()]:
            if self._moves(read) and not self.port.gone:
                self._fill(read)
        answers, self._answers, self.backlog = self._answers, [], 0
        self.port.timeline.changed()
        return b"".join(answers)

    def _moves(self, read: _Read) -> bool:
        queue = self.port.queue(read.submit.endpoint)
        return bool(queue) or queue.halted

    def _fill(self, read: _Read) -> None:
        """Move what waits on the endpoint into the read, and answer it if it is complete."""
        submit, queue = read.submit, self.port.queue(read.submit.endpoint)
        status, room = 0, submit.length - len(read.data)
        # A byte more than what waits: only a short packet ends it then.
        part = bytearray(min(room, len(queue) + 1))
        try:
            if queue.halted:
                status, done = -errno.EPIPE, True
            else:
                count, done = queue.take(memoryview(part))
                read.data += part[:count]
                self.port.spend(count)
                if done and submit.flags & SHORT_NOT_OK and len(read.data) < submit.length:
                    status = -errno.EREMOTEIO
        except Overflow:
            status, done = -errno.EOVERFLOW, True
        if done:
            del self._reads[submit.number]
            self._answer(submitted(submit, status, len(read.data), bytes(read.data)))

    def _control(self, submit: Submit, data: bytes) -> None:
        setup = submit.setup
        try:
            answer = control(self.port, setup, data)
        except Stall:
            self._answer(submitted(submit, -errno.EPIPE, 0))
            return
        if submit.to_host:
            answer = answer[: min(setup.length, submit.length)]
            self._answer(submitted(submit, 0, len(answer), answer))
        else:
            self._answer(submitted(submit, 0, len(data)))

    def _write(self, submit: Submit, data: bytes) -> None:
        port, size = self.port, self.port.packet(submit.endpoint)
        end = len(data) + (submit.flags & ZERO_PACKET != 0 and len(data) % size == 0)
        for at in range(0, max(1, end), size):
            if submit.endpoint in port.halted_out:
                self._answer(submitted(submit, -errno.EPIPE, at))
                return
            port.device.on_bulk_out(submit.endpoint, data[at : at + size])
        self._answer(submitted(submit, 0, len(data)))

    def _answer(self, data: bytes) -> None:
        self._answers.append(data)
        self.backlog += len(data)
