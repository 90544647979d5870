"""The stream of a GigE Vision device: where it sends, in what packets, and the thread that takes them."""

import contextlib
import queue
import socket
import threading
import time
from collections.abc import Callable

from drivers.clock import Clock
from drivers.errors import CameraLost, CameraProtocol, CameraRefused, CameraTimeout
from drivers.genicam.chunks import CHUNKS
from drivers.genicam.session import Frame
from drivers.gige import gvsp
from drivers.gige.assembly import GIVEN_UP, Assembler
from drivers.gige.control import ControlChannel
from drivers.gige.registers import DO_NOT_FRAGMENT, FIRE_TEST, Bootstrap
from imaging.errors import CameraError

_BUFFER = 64 << 20
"""Bytes that may wait in the system; it grants what it allows."""
_FORCED_BUFFER = 33
"""SO_RCVBUFFORCE of Linux, for those who may."""
_LARGEST_DATAGRAM, _LARGEST_PAYLOAD = 1 << 16, 1 << 31
_SAFE, _SMALLER, _LARGER = 1500, (1400, 576), (9000, 8000, 4000)
"""Packet sizes: what Ethernet carries everywhere; for tunnels; where all on the way are set to it."""
_TEST = 0.05
"""Seconds in which a test packet comes."""
_TICK = 0.002
"""Seconds between looks at what is missing."""


class StreamChannel:
    """Stream receiver: configures the device to send to this host, and yields frames; errors as
    `ControlChannel`.

    What is lost on the way is asked for again, also from devices that do not say that they can do that.
    """

    def __init__(self, control: ControlChannel, payload: Callable[[], int], clock: Clock) -> None:
        """`payload()` is the size of a frame as the device is set, bytes."""
        self._control, self._payload_size, self._clock = control, payload, clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._frames: queue.Queue[Frame] = queue.Queue()
        self._receiving: threading.Thread | None = None
        self._stopping = threading.Event()
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            with contextlib.suppress(OSError):  # only root may
                self._socket.setsockopt(socket.SOL_SOCKET, _FORCED_BUFFER, _BUFFER)
            self._socket.bind((control.host, 0))
            number = control.write_number
            number(Bootstrap.STREAM_DESTINATION, 4, int.from_bytes(socket.inet_aton(control.host), "big"))
            number(Bootstrap.STREAM_PORT, 4, self._socket.getsockname()[1])
            self.packet_size = self._agree()
        except CameraError:
            self._socket.close()
            raise
        except OSError as error:
            self._socket.close()
            where = self._control.where
            raise CameraLost(f"{where} cannot send here ({error.strerror}): check the network.") from error

    def start(self) -> None:
        """Take what comes from now on; AcquisitionStart comes after."""
        self.stop()
        payload = self._payload_size()
        if not 0 < payload <= _LARGEST_PAYLOAD:
            raise CameraProtocol(
                f"{self._control.where} announces frames of {payload} bytes: reset the camera."
            )
        self._drain()
        self._open_firewall()
        self._frames = queue.Queue()
        self._stopping.clear()
        assembler = Assembler(payload, self.packet_size)
        self._receiving = threading.Thread(
            target=self._receive, args=(assembler, self._frames), name="gige stream", daemon=True
        )
        self._receiving.start()

    def stop(self) -> None:
        """Take no more; AcquisitionStop comes before."""
        if self._receiving is not None:
            self._stopping.set()
            self._receiving.join()
            self._receiving = None

    def close(self) -> None:
        """Stop, and have the device send nowhere; a second time does nothing."""
        self.stop()
        if self._socket.fileno() >= 0:
            with contextlib.suppress(CameraError):  # it has gone, or given its control to another
                self._control.write_number(Bootstrap.STREAM_PORT, 4, 0)
        self._socket.close()

    def next_frame(self, timeout: float) -> Frame:
        """The next frame, complete or not, within `timeout` s and what it takes to come. CameraTimeout."""
        # A frame that is coming in is waited for: only silence ends the wait.
        deadline = self._clock.now() + timeout
        while True:
            try:
                frame = self._frames.get(timeout=_TEST)
                break
            except queue.Empty:
                if self._clock.now() < max(deadline, self._heard + 2 * GIVEN_UP):
                    continue
                raise CameraTimeout(
                    f"{self._control.where} sent no frame within {timeout:.3g} s: check trigger and "
                    "exposure, and that no firewall holds back its packets."
                ) from None
        if frame.leader.payload_type & ~CHUNKS != gvsp.IMAGE:
            raise CameraRefused(
                f"{self._control.where} sends payloads of type {frame.leader.payload_type:#06x}, not images."
            )
        return frame

    _heard = float("-inf")
    """Time of the last packet."""

    def _receive(self, assembler: Assembler, frames: queue.Queue[Frame]) -> None:
        """Assemble packets to frames and request missing ones, until `stop`."""
        buffer = memoryview(bytearray(_LARGEST_DATAGRAM))
        self._socket.settimeout(_TICK)
        look = time.monotonic()
        while not self._stopping.is_set():
            try:
                size, (sender, _) = self._socket.recvfrom_into(buffer)
            except TimeoutError:
                size, sender = 0, ""
            now = time.monotonic()
            if size and sender == self._control.address:
                self._heard = self._clock.now()
                with contextlib.suppress(CameraProtocol):  # damaged: it is missed, and asked for again
                    frame = assembler.feed(buffer[:size], now)
                    if frame is not None:
                        frames.put(frame)
            if now >= look:
                look = now + _TICK
                for wanted in assembler.due(now):
                    self._control.resend(wanted)
                for frame in assembler.given_up(now):
                    frames.put(frame)

    def _agree(self) -> int:
        """Set the largest packets that arrive, of a few sizes; a safe one where the device sends no test."""
        set_to = self._control.read_number(Bootstrap.STREAM_PACKET_SIZE, 4)
        best = next((size for size in (_SAFE, *_SMALLER) if self._arrives(size)), None)
        if best == _SAFE:
            best = next((size for size in _LARGER if self._arrives(size)), _SAFE)
        if best is None:
            best = min(set_to & 0xFFFF or _SAFE, _SAFE)
            set_to = best
        else:
            set_to = best | DO_NOT_FRAGMENT
        self._control.write_number(Bootstrap.STREAM_PACKET_SIZE, 4, set_to)
        # Devices round to what they can send.
        return self._control.read_number(Bootstrap.STREAM_PACKET_SIZE, 4) & 0xFFFF or best

    def _arrives(self, size: int) -> bool:
        """Return whether a test packet of that size comes."""
        self._drain()
        try:
            self._control.write_number(Bootstrap.STREAM_PACKET_SIZE, 4, size | FIRE_TEST | DO_NOT_FRAGMENT)
        except CameraRefused:
            return False
        self._socket.settimeout(_TEST)
        try:
            while True:
                data, (sender, _) = self._socket.recvfrom(_LARGEST_DATAGRAM)
                if sender == self._control.address and len(data) == gvsp.datagram_size(size):
                    return True
        except OSError:
            return False

    def _open_firewall(self) -> None:
        """A datagram to where the stream comes from: firewalls let answers in."""
        with contextlib.suppress(CameraRefused, OSError):  # not every device says where that is
            port = self._control.read_number(Bootstrap.STREAM_SOURCE_PORT, 4) & 0xFFFF
            if port:
                self._socket.sendto(b"\0", (self._control.address, port))

    def _drain(self) -> None:
        """Forget what has come so far."""
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):
            while True:
                self._socket.recv(_LARGEST_DATAGRAM)
