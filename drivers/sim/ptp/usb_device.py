"""A PTP responder as a device on the virtual bus: containers in packets, class requests, and their faults.

USB Still Image Capture Device Definition 1.0: one bulk pipe each way, events on an interrupt pipe.
"""

import struct
from dataclasses import replace

from drivers.errors import CameraProtocol
from drivers.ptp.protocol.codec import HEADER_SIZE, Command, ContainerType, Data, Event, Header, Response
from drivers.ptp.protocol.codes import ResponseCode
from drivers.sim.faults import Fault, Kind
from drivers.sim.ptp.operations import Request
from drivers.sim.ptp.responder import Responder
from drivers.sim.usb.descriptors import Description, Endpoint, Interface
from drivers.sim.usb.port import Port, Setup, Stall
from drivers.usb import STILL_IMAGE

OUT, IN, EVENTS = 0x02, 0x81, 0x83
PACKET, EVENT_PACKET = 512, 32
_CANCEL, _RESET, _STATUS = 0x64, 0x66, 0x67
_CLASS_OUT, _CLASS_IN = 0x21, 0xA1
_MOST = 1 << 24
"""Bytes of the longest container that it takes."""

_CARRIER = frozenset(
    {
        Kind.STALL,
        Kind.TIMEOUT,
        Kind.TRUNCATED,
        Kind.WRONG_TRANSACTION,
        Kind.UNPLUG,
        Kind.SPLIT_HEADER,
        Kind.MERGED_RESPONSE,
        Kind.CORRUPT_LENGTH,
        Kind.NO_RESPONSE,
        Kind.FREEZE,
    }
)
"""Faults of the connection, not of the camera."""


class PtpDevice:
    """Plug it into a `VirtualBus`. What is stored survives being unplugged, a session does not."""

    def __init__(self, responder: Responder) -> None:
        self.responder = responder
        self._port: Port | None = None
        self._received = b""
        self._command: Command | None = None
        self._frozen = False
        """True while it hears nothing, and its shutter and its buttons stay as they are."""
        responder.listener = self._send_event

    @property
    def description(self) -> Description:
        """High speed, one interface; strings are the maker, the model and the serial number."""
        profile = self.responder.profile
        pipes = (
            Endpoint(OUT, "bulk", PACKET),
            Endpoint(IN, "bulk", PACKET),
            Endpoint(EVENTS, "interrupt", EVENT_PACKET),
        )
        code = (STILL_IMAGE.number, STILL_IMAGE.subclass, STILL_IMAGE.protocol)
        return Description(
            profile.vendor,
            profile.product,
            (profile.maker, profile.model, self.responder.serial),
            (Interface(0, code, pipes),),
        )

    def on_attach(self, port: Port) -> None:
        """Begin anew."""
        self._port = port
        self.on_reset()

    def on_reset(self) -> None:
        """Forget what was under way."""
        self._received, self._command = b"", None
        self.responder.reset()

    def on_clear_halt(self, endpoint: int) -> None:
        """Clear the halt."""
        self._received, self._command = b"", None

    def on_control(self, setup: Setup, data: bytes) -> bytes:
        """The requests of the class. Stall."""
        assert self._port is not None
        if self._frozen:
            raise Stall
        if (setup.request_type, setup.request) == (_CLASS_OUT, _CANCEL):
            self._received, self._command = b"", None
            self._port.queue(IN).clear()
            return b""
        if (setup.request_type, setup.request) == (_CLASS_OUT, _RESET):
            self._port.reset()
            return b""
        if (setup.request_type, setup.request) == (_CLASS_IN, _STATUS):
            halted = self._port.halted()
            code = ResponseCode.TRANSACTION_CANCELLED if halted else ResponseCode.OK
            return struct.pack(f"<HH{len(halted)}I", 4 + 4 * len(halted), code, *halted)
        raise Stall

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        """Take a part of a container; invalid data halt the pipe."""
        self._received += packet
        try:
            if len(self._received) >= HEADER_SIZE:
                header = Header.unpack(self._received)
                if header.length > _MOST:
                    self._halt()
                elif len(self._received) >= header.length:
                    container, self._received = self._received, b""
                    self._take(header, container)
            elif self._received and len(packet) < PACKET:
                self._halt()
        except CameraProtocol:
            self._halt()

    def _halt(self) -> None:
        assert self._port is not None
        self._received, self._command = b"", None
        self._port.halt(OUT)
        self._port.halt(IN)

    def _take(self, header: Header, container: bytes) -> None:
        """A whole container from the host."""
        if header.kind is ContainerType.COMMAND:
            command = Command.unpack(container)
            self._command = command
            if not self.responder.takes_data(command.code):
                self._run(command, b"")
        elif header.kind is ContainerType.DATA and self._command is not None:
            command, data = self._command, Data.unpack(container)
            if (data.code, data.transaction) != (command.code, command.transaction):
                self._halt()
            else:
                self._run(command, data.payload)
        else:
            self._halt()

    def _run(self, command: Command, data: bytes) -> None:
        """Run the operation, unless a fault prevents it, and queue the answer."""
        assert self._port is not None
        self._command = None
        if self._frozen:
            return
        request = Request(command.code, command.transaction, command.parameters, data)
        faults = self.responder.faults(request, _CARRIER)
        fault_of = {fault.kind: fault for fault in faults}
        if Kind.STALL in fault_of:
            self._port.halt(IN)
            return
        if Kind.TIMEOUT in fault_of:
            return
        if unplug := fault_of.get(Kind.UNPLUG):
            self._port.unplug_at(max(1, unplug.count), unplug.seconds)
        reply = self.responder.handle(replace(request, faults=faults))
        if freeze := fault_of.get(Kind.FREEZE):
            self._frozen = True
            self.responder.timeline.call_later(freeze.seconds, self._thaw)
            return
        transaction = command.transaction + (Kind.WRONG_TRANSACTION in fault_of)
        response = Response(reply.code, transaction, reply.parameters).pack()
        if reply.data is None:
            self._port.send(IN, _with_length(response, fault_of.get(Kind.CORRUPT_LENGTH)))
            return
        container = Data(command.code, transaction, reply.data).pack()
        container = _with_length(container, fault_of.get(Kind.CORRUPT_LENGTH))
        if cut := fault_of.get(Kind.TRUNCATED):
            container = container[: HEADER_SIZE + cut.count]
        if Kind.SPLIT_HEADER in fault_of:
            self._port.send(IN, container[:HEADER_SIZE])
            container = container[HEADER_SIZE:]
        if Kind.MERGED_RESPONSE in fault_of:
            self._port.send(IN, container + response)
        elif Kind.NO_RESPONSE in fault_of:
            self._port.send(IN, container)
        else:
            self._port.send(IN, container)
            self._port.send(IN, response)

    def _thaw(self) -> None:
        """Resume work, with no session open."""
        self._frozen = False
        self.responder.reset()

    def _send_event(self, event: Event) -> None:
        if self._port is not None:
            self._port.send(EVENTS, event.pack())


def _with_length(container: bytes, fault: Fault | None) -> bytes:
    """The container, its length off by the fault's count."""
    if fault is None:
        return container
    header = Header.unpack(container)
    return replace(header, length=header.length + (fault.count or 1)).pack() + container[HEADER_SIZE:]
