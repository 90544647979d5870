"""A simulated GigE Vision camera on UDP: control, stream, and action commands at once or at a time."""

import select
import socket
import struct
import threading
from contextlib import suppress
from typing import Self

from drivers.errors import CameraProtocol
from drivers.gige import gvcp
from drivers.gige.gvcp import ACKNOWLEDGE, Action, Answer, Code, Command, Resend
from drivers.gige.registers import DISCOVERY_SIZE, FIRE_TEST, LATCH, Bootstrap
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.genicam import frames
from drivers.sim.genicam.acquisition import ACTION, Acquisition
from drivers.sim.genicam.feature_registers import Feature
from drivers.sim.genicam.lines import Oscillator
from drivers.sim.genicam.memory import Denied
from drivers.sim.genicam.power_on import checks_of, description_of, power_on
from drivers.sim.genicam.quirks import Quirk
from drivers.sim.gige.clock import SETTLING, NetworkTime
from drivers.sim.gige.events import Events
from drivers.sim.gige.memory import GIGE, PACKET_SIZES, STATUSES, GigeMemory
from drivers.sim.gige.stream import Sender
from drivers.sim.seeds import generator
from drivers.sim.usb.timeline import Timeline
from drivers.u3v.gencp import Status
from imaging.sensor.mosaic import RawMosaic

_PENDING_MS = 150
_LONGEST_WAIT = 0.2
"""Seconds between looks at whether it is closed, or its host has fallen silent."""
Host = tuple[str, int]


class GigeDevice:
    """Answers at an IPv4 address of this machine until it is closed; several of 127.0.0.0/8 are a network.

    loss: the share of commands and of answers that get lost; `sender.loss`: of the packets of frames.
    skew: seconds by which its shutter opens after an action command. opened: when each exposure began, on the
    timeline: what measured times are held against. events: those that it sent.
    """

    def __init__(
        self,
        camera: SimulatedCamera,
        timeline: Timeline,
        address: str,
        *,
        network_time: NetworkTime | None = None,
        skew: float = 0.0,
        extended_ids: bool = False,
        beside: str | None = None,
        quirks: frozenset[Quirk] = frozenset(),
    ) -> None:
        """A camera of kind "raw". OSError.

        beside: the address of a second interface, at which it is discovered and not controlled.
        """
        self._quirks, self._ptp, self._half = quirks, "Disabled", b""
        self.events = Events()
        self.address, self.skew, self.loss = address, skew, 0.0
        self.opened: list[float] = []
        self._camera, self._timeline = camera, timeline
        self._identity = camera.identify()
        self.serial = self._identity.serial
        self._network_time = network_time
        self.oscillator = Oscillator.of(camera.body.seed, self.serial)
        self._checks = checks_of(camera)
        self._memory = GigeMemory(self._identity, address, description_of(camera, GIGE, quirks), quirks)
        power_on(camera, self._memory, quirks)
        self._chance = generator(camera.body.seed, "network", self.serial)
        self._host: Host | None = None
        self._heard = 0.0
        self._answered: tuple[Host, int, bytes] | None = None
        self._block = 0
        self._sockets = [_bound(address, gvcp.PORT)]
        self._beside = None if beside is None else _bound(beside, gvcp.PORT)
        if self._beside is not None:
            self._sockets.append(self._beside)
        self.sender = Sender(
            _bound(address, 0), generator(camera.body.seed, "frames", self.serial), extended_ids, quirks
        )
        self._memory.put(Bootstrap.STREAM_SOURCE_PORT, self.sender.socket.getsockname()[1])
        self._show_time_status()
        self._acquisition = Acquisition(
            camera, self._memory, timeline, lambda: self._memory.streams, self._deliver, self._shutter_moved
        )
        self._refresh()
        self._closing = threading.Event()
        self._serving = threading.Thread(target=self._serve, name=f"gige {address}", daemon=True)
        self._serving.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Fall silent."""
        self._closing.set()
        self._serving.join()
        with self._timeline.lock:
            self._acquisition.stop()
            for link in (*self._sockets, self.sender.socket):
                link.close()

    def nanoseconds(self, now: float) -> int:
        """Return what its clock shows at a time of the timeline."""
        if self._network_time is not None and self._is_synchronised():
            return self._network_time.nanoseconds(self.serial, now)
        return self.oscillator.nanoseconds(now)

    def _serve(self) -> None:
        while not self._closing.is_set():
            ready, _, _ = select.select(self._sockets, [], [], _LONGEST_WAIT)
            with self._timeline.lock:
                self._listen_for_heart()
                for link in ready:
                    with suppress(OSError, CameraProtocol):  # anything but a command is dropped
                        data, host = link.recvfrom(2048)
                        if not gvcp.is_command(data):
                            self.events.heard(data)
                            continue
                        command = Command.parse(data)
                        if link is self._beside:
                            link.sendto(self._elsewhere(command), host)
                        else:
                            self._receive(command, host)

    def _elsewhere(self, command: Command) -> bytes:
        """The answer at an interface that is not the one which it is controlled by."""
        if command.code == Code.DISCOVERY:
            return Answer(0, Code.DISCOVERY_ACK, command.request_id, self._do(command, ("", 0))).pack()
        refusal = gvcp.refusal_payload(command.code)
        return Answer(
            int(Status.ACCESS_DENIED), command.code + 1 & 0xFFFF, command.request_id, refusal
        ).pack()

    def _receive(self, command: Command, host: Host) -> None:
        if self._is_lost():
            return
        if self._answered is not None and self._answered[:2] == (host, command.request_id):
            self._send(self._answered[2], host)  # asked again: done already
            return
        if host == self._host:
            self._heard = self._timeline.now()
            if Quirk.EVENTS in self._quirks:
                stamp = self.nanoseconds(self._heard)
                self._send(self.events.next(command.request_id, self._block, stamp), host)
        if command.code == Code.RESEND:
            if self._memory.streams:
                self.sender.again(Resend.parse(command), self._memory.destination)
            return
        try:
            payload, status = self._do(command, host), 0
        except Denied as denied:
            payload, status = gvcp.refusal_payload(command.code), int(denied.status)
        except struct.error:
            payload, status = gvcp.refusal_payload(command.code), int(Status.BAD_PARAMETER)
        if command.flags & ACKNOWLEDGE:
            answer = Answer(status, command.code + 1 & 0xFFFF, command.request_id, payload).pack()
            if command.code not in (Code.DISCOVERY, Code.ACTION):
                self._answered = host, command.request_id, answer
            if Quirk.PENDING in self._quirks and command.code == Code.WRITE_MEMORY:
                wait = Answer(0, Code.PENDING_ACK, command.request_id, gvcp.number_payload(_PENDING_MS))
                self._send(wait.pack(), host)
                self._timeline.call_later(_PENDING_MS / 1000, lambda: self._send(answer, host))
                return
            self._send(answer, host)

    def _send(self, answer: bytes, host: Host) -> None:
        if not self._is_lost():
            self._sockets[0].sendto(answer, host)

    def _is_lost(self) -> bool:
        return bool(self._chance.random() < self.loss)

    def _do(self, command: Command, host: Host) -> bytes:
        """Return what a command's answer carries. Denied."""
        payload, memory = command.payload, self._memory
        if command.code == Code.DISCOVERY:
            return memory.read(0, DISCOVERY_SIZE)
        if command.code == Code.ACTION:
            self._act(Action.parse(command))
            return b""
        if command.code == Code.READ_REGISTER:
            addresses = struct.unpack(f">{len(payload) // 4}I", payload)
            return b"".join(memory.read(address, 4) for address in addresses)
        if command.code == Code.READ_MEMORY:
            address, _, size = struct.unpack(">IHH", payload)
            if address % 4 or size % 4 or size > gvcp.MOST_MEMORY:
                raise Denied(Status.MISALIGNED)
            return payload[:4] + memory.read(address, size)
        if command.code == Code.WRITE_REGISTER:
            for start in range(0, len(payload) - 7, 8):
                self._write(
                    int.from_bytes(payload[start : start + 4], "big"), payload[start + 4 : start + 8], host
                )
            return gvcp.number_payload(len(payload) // 8)
        if command.code == Code.WRITE_MEMORY and Quirk.NO_WRITE_MEMORY not in self._quirks:
            if len(payload) < 8 or len(payload) % 4:
                raise Denied(Status.MISALIGNED)
            self._write(int.from_bytes(payload[:4], "big"), payload[4:], host)
            return gvcp.number_payload(len(payload) - 4)
        raise Denied(Status.NOT_IMPLEMENTED)

    def _write(self, address: int, data: bytes, host: Host) -> None:
        memory = self._memory
        if memory.controlled and host != self._host:
            raise Denied(Status.ACCESS_DENIED)
        if not memory.controlled and address != Bootstrap.CONTROL_PRIVILEGE:
            raise Denied(Status.ACCESS_DENIED)
        if address & ~7 == Feature.EXPOSURE_TIME and len(data) == 4:
            # A word at a time, of which the second counts.
            if address == Feature.EXPOSURE_TIME:
                self._half = data
                return
            address, data = Feature.EXPOSURE_TIME, (self._half or memory.read(address - 4, 4)) + data
        self._checks.check(memory, address, data)
        if address == Bootstrap.STREAM_PACKET_SIZE:
            if len(data) != 4:
                raise Denied(Status.BAD_PARAMETER)
            self._set_packet_size(int.from_bytes(data, "big"))
            return
        memory.write(address, data)
        self._refresh()
        if address == Bootstrap.CONTROL_PRIVILEGE:
            self._host, self._heard = (host if memory.controlled else None), self._timeline.now()
            if not memory.controlled:
                self._let_go()
        elif address == Bootstrap.TIMESTAMP_CONTROL and memory.get(address) & LATCH:
            memory.put(Bootstrap.TIMESTAMP, self.nanoseconds(self._timeline.now()), 8)
        elif address == Feature.PTP_ENABLE:
            self._agree_on_time(bool(memory.get(address)))
        elif address == Feature.TIME_LATCH:
            self._show_time_status()
        self._acquisition.written(address)

    def _set_packet_size(self, value: int) -> None:
        size = value & 0xFFFC
        if not PACKET_SIZES[0] <= size <= PACKET_SIZES[1]:
            raise Denied(Status.BAD_PARAMETER)
        self._memory.put(Bootstrap.STREAM_PACKET_SIZE, (value & ~(FIRE_TEST | 0xFFFF)) | size)
        if value & FIRE_TEST and self._memory.streams:
            self.sender.test(size, self._memory.destination)

    def _listen_for_heart(self) -> None:
        timeout = self._memory.get(Bootstrap.HEARTBEAT_TIMEOUT) / 1000
        if self._memory.controlled and self._timeline.now() - self._heard > timeout:
            self._memory.put(Bootstrap.CONTROL_PRIVILEGE, 0)
            self._let_go()

    def _let_go(self) -> None:
        """No host any more: nothing is sent to anybody."""
        self._host = None
        self._acquisition.stop()
        self.sender.forget()
        self._memory.put(Bootstrap.STREAM_PORT, 0)

    def _agree_on_time(self, on: bool) -> None:
        """Begin, or cease, to follow the time of the network, which takes a moment."""
        self._ptp = "Listening" if on else "Disabled"
        if Quirk.LATCHED_TIME not in self._quirks:
            self._show_time_status()
        if on and self._network_time is not None:
            self._timeline.call_later(SETTLING, self._agreed)

    def _agreed(self) -> None:
        if self._memory.get(Feature.PTP_ENABLE):
            self._ptp = "Slave"
            if Quirk.LATCHED_TIME not in self._quirks:
                self._show_time_status()

    def _is_synchronised(self) -> bool:
        return self._ptp == "Slave"

    def _show_time_status(self) -> None:
        self._memory.put(Feature.PTP_STATUS, STATUSES.index(self._ptp))

    def _act(self, action: Action) -> None:
        """Pull the trigger if it is meant. Denied, of which the latter two are GVCP's alone."""
        get = self._memory.get
        if (
            action.device_key != get(Bootstrap.ACTION_DEVICE_KEY)
            or action.group_key != get(Bootstrap.ACTION_GROUP_KEY)
            or not action.group_mask & get(Bootstrap.ACTION_GROUP_MASK)
        ):
            return
        now = when = self._timeline.now()
        if action.time is not None:
            if self._network_time is None or not self._is_synchronised():
                return  # a time means nothing to it
            when = max(self._network_time.when(self.serial, action.time), now)
        when += self.skew
        # The shutter is hardware: it opens at the moment, however late this thread comes to it.
        self._timeline.call_later(when - now, lambda: self._acquisition.pulse(ACTION, at=when))

    def _shutter_moved(self, is_open: bool, when: float) -> None:
        if is_open:
            self.opened.append(when)

    def _deliver(self, mosaic: RawMosaic, time: float, opened: float) -> None:
        memory = self._memory
        self._block = self._block % 0xFFFF + 1
        if not memory.streams:
            return
        image = frames.frame(memory, mosaic, self._camera.body.sensor.bit_depth, time)
        stamp = self.nanoseconds(opened)
        self.sender.frame(image, self._block, stamp, memory.packet_size, memory.destination)

    def _refresh(self) -> None:
        body = self._camera.body
        frames.refresh(self._memory, body.cfa, body.sensor.black, body.sensor.bit_depth)


def _bound(address: str, port: int) -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        if address.endswith(".255"):  # several devices hear the same broadcast
            link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        link.bind((address, port))
    except OSError:
        link.close()
        raise
    return link
