"""A simulated USB3 Vision camera on the virtual bus: control packets, the stream, and their faults.

Operations of its fault plan: "ReadMem" and "WriteMem" for control packets, "Frame" for frames.
"""

import struct

from drivers.errors import CameraProtocol
from drivers.genicam.chunks import CHUNKS
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import Fault, FaultPlan, Kind
from drivers.sim.genicam import frames
from drivers.sim.genicam.acquisition import Acquisition
from drivers.sim.genicam.description import Transport
from drivers.sim.genicam.feature_registers import Feature
from drivers.sim.genicam.lines import Oscillator, Wire
from drivers.sim.genicam.memory import Denied
from drivers.sim.genicam.power_on import checks_of, description_of, power_on
from drivers.sim.seeds import generator
from drivers.sim.u3v.memory import LARGEST_PACKET, DeviceMemory
from drivers.sim.usb.descriptors import SUPER_SPEED, Description, Endpoint, Interface
from drivers.sim.usb.port import Port, Setup, Stall
from drivers.sim.usb.timeline import Action, Timeline
from drivers.u3v import gencp
from drivers.u3v.gencp import Code, Packet, Status
from drivers.u3v.registers import STRING, Abrm, Sirm
from drivers.u3v.stream import IMAGE, Leader, Trailer
from drivers.usb import U3V_CONTROL, U3V_STREAM
from imaging.sensor.mosaic import RawMosaic

CONTROL_OUT, CONTROL_IN, STREAM_IN = 0x01, 0x81, 0x82
PACKET = 1024
BUFFER = 64 << 20
"""Bytes that may wait for the host; a camera drops frames that do not fit into its memory."""
_WAY = 40e-6
"""Seconds that a control packet is late at least, beyond the bus's own time; on average again as much."""
VENDOR, PRODUCT = 0x1209, 0x0453
_ABOUT = struct.pack("<BBBII", 20, 0x24, 1, 0x00010000, 0x00010000) + bytes((4, 1, 2, 0, 0, 0, 3, 0, 8))
"""The class-specific descriptor: versions of GenCP and USB3 Vision, and which string says what."""
_USB = Transport(
    "USB",
    "little",
    ((Abrm.MANUFACTURER, STRING), (Abrm.MODEL, STRING), (Abrm.SERIAL, STRING)),
    (Abrm.LATCH, 1),
    Abrm.TIMESTAMP,
    sources={},
    categories={},
    parts=(),
)
_OF_CONTROL = frozenset(
    {
        Kind.BUSY,
        Kind.STALL,
        Kind.TIMEOUT,
        Kind.WRONG_TRANSACTION,
        Kind.TRUNCATED,
        Kind.CORRUPT_LENGTH,
        Kind.UNPLUG,
    }
)
_OF_FRAMES = frozenset(
    {
        *(Kind.STALL, Kind.TIMEOUT, Kind.NO_TRAILER, Kind.DROPPED_PAYLOAD, Kind.UNPLUG),
        Kind.FEWER_ROWS,
    }
)


class U3vDevice:
    """Plug it into a `VirtualBus`. What the host has set is lost when it is unplugged, as on real ones."""

    def __init__(self, camera: SimulatedCamera, timeline: Timeline, plan: FaultPlan | None = None) -> None:
        """A camera of kind "raw"."""
        self._camera, self._timeline = camera, timeline
        self._plan = plan or FaultPlan(timeline)
        self._identity = camera.identify()
        self._port: Port | None = None
        self._received = b""
        self._busy_until, self._busy_times, self._block = 0.0, 0, 0
        seed, self.serial = camera.body.seed, self._identity.serial
        self.oscillator = Oscillator.of(seed, self.serial)
        self.wires: dict[int, Wire] = {}
        """Wires on its lines, by number."""
        self.opened: list[float] = []
        """Start of each exposure on the timeline: the truth for measured times."""
        self._lateness = generator(seed, "control channel", self.serial)
        self._acquisition: Acquisition | None = None
        self._memory = self._start_anew()

    @property
    def description(self) -> Description:
        """SuperSpeed; the serial number is that of the camera."""
        pipes = (Endpoint(CONTROL_OUT, "bulk", PACKET), Endpoint(CONTROL_IN, "bulk", PACKET))
        control = (U3V_CONTROL.number, U3V_CONTROL.subclass, U3V_CONTROL.protocol)
        stream = (U3V_STREAM.number, U3V_STREAM.subclass, U3V_STREAM.protocol)
        identity = self._identity
        return Description(
            VENDOR,
            PRODUCT,
            (identity.make, identity.model, identity.serial, f"{VENDOR:04x}{identity.serial}"),
            (
                Interface(0, control, pipes, extra=_ABOUT),
                Interface(1, stream, (Endpoint(STREAM_IN, "bulk", PACKET),)),
            ),
            code=(0xEF, 0x02, 0x01),
            speed=SUPER_SPEED,
            function=control,
        )

    def line(self, number: int, rising: bool = True) -> None:
        """An edge on a line."""
        with self._timeline.lock:
            if self._acquisition is not None:
                self._acquisition.edge(number, rising)

    def on_attach(self, port: Port) -> None:
        """Power comes on: everything is as at first."""
        if self._acquisition is not None:
            self._acquisition.stop()
        self._port, self._received = port, b""
        self._busy_until, self._busy_times = 0.0, 0
        self._memory = self._start_anew()
        self._acquisition = Acquisition(
            self._camera,
            self._memory,
            self._timeline,
            lambda: bool(self._memory.stream(Sirm.CONTROL) & 1),
            self._deliver,
            self._shutter_moved,
        )
        self._refresh()

    def on_reset(self) -> None:
        """Packets under way are forgotten."""
        self._received = b""
        if self._acquisition is not None:
            self._acquisition.stop()

    def on_clear_halt(self, endpoint: int) -> None:
        """Clear the halt, and drop what waited behind it."""
        self._received = b""
        if endpoint & 0x80:
            self._live().queue(endpoint).clear()

    def on_control(self, setup: Setup, data: bytes) -> bytes:
        """Stall: there are no class requests."""
        raise Stall

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        """Take a part of a command; invalid data halt the pipe."""
        self._received += packet
        if len(packet) == PACKET and len(self._received) < LARGEST_PACKET:
            return
        data, self._received = self._received, b""
        self._later(lambda: self._receive(data))

    def _later(self, act: Action) -> None:
        """Run a little later, after the delay of the bus, unless it is unplugged by then."""
        port = self._live()
        late = _WAY + float(self._lateness.exponential(_WAY))
        self._timeline.call_later(late, lambda: act() if port is self._port and not port.gone else None)

    def _receive(self, data: bytes) -> None:
        try:
            self._do(Packet.parse(data))
        except CameraProtocol:
            self._live().halt(CONTROL_IN)

    def _shutter_moved(self, is_open: bool, when: float) -> None:
        if is_open:
            self.opened.append(when)
        for number, wire in self.wires.items():
            if self._memory.get(Feature.LINE_CONTROL, number) & 0x11 == 0x11:
                wire.edge(is_open, self)

    def _live(self) -> Port:
        assert self._port is not None
        return self._port

    def _do(self, command: Packet) -> None:
        faults = {fault.kind: fault for fault in self._faults(command.code)}
        if Kind.STALL in faults:
            self._live().halt(CONTROL_IN)
            return
        if Kind.TIMEOUT in faults:
            return
        if busy := faults.get(Kind.BUSY):
            self._busy_until = self._timeline.now() + busy.seconds
            self._busy_times = busy.count
        if self._is_busy():
            self._busy_times = max(0, self._busy_times - 1)
            answer = Packet(Status.BUSY, command.code + 1, command.request_id)
        else:
            answer = self._answer(command)
        if Kind.WRONG_TRANSACTION in faults:
            answer = Packet(answer.word, answer.code, (answer.request_id + 1) & 0xFFFF, answer.payload)
        data = answer.pack()
        if truncated := faults.get(Kind.TRUNCATED):
            data = data[: truncated.count]
        if corrupt := faults.get(Kind.CORRUPT_LENGTH):
            size = (len(answer.payload) + corrupt.count) & 0xFFFF
            data = data[:8] + size.to_bytes(2, "little") + data[10:]
        if unplug := faults.get(Kind.UNPLUG):
            self._live().unplug_at(max(unplug.count, 1), unplug.seconds)
        self._later(lambda: self._live().send(CONTROL_IN, data))

    def _faults(self, code: int) -> tuple[Fault, ...]:
        name = {int(Code.READ): "ReadMem", int(Code.WRITE): "WriteMem"}.get(code)
        if name is None or self._is_busy():
            return ()
        return self._plan.strike(self._identity.serial, name, _OF_CONTROL)

    def _is_busy(self) -> bool:
        return self._busy_times > 0 or self._timeline.now() < self._busy_until

    def _answer(self, command: Packet) -> Packet:
        try:
            if command.code == Code.READ:
                address, size = gencp.parse_read_payload(command.payload)
                if size > LARGEST_PACKET - gencp.HEADER_SIZE:
                    raise Denied(Status.BAD_PARAMETER)
                data = self._memory.read(address, size)
                return Packet(Status.SUCCESS, Code.READ_ACK, command.request_id, data)
            if command.code == Code.WRITE:
                address, data = gencp.parse_write_payload(command.payload)
                self._checks.check(self._memory, address, data)
                self._memory.write(address, data)
                self._refresh()
                if not self._memory.stream(Sirm.CONTROL) & 1:
                    # Unread frames are of the stream that ends.
                    self._live().queue(STREAM_IN).clear()
                if address == Abrm.LATCH:
                    self._memory.latch(self.oscillator.nanoseconds(self._timeline.now()))
                if self._acquisition is not None:
                    self._acquisition.written(address)
                written = gencp.number_payload(len(data))
                return Packet(Status.SUCCESS, Code.WRITE_ACK, command.request_id, written)
        except Denied as denied:
            return Packet(denied.status, command.code + 1, command.request_id)
        return Packet(Status.NOT_IMPLEMENTED, command.code + 1 & 0xFFFF, command.request_id)

    def _deliver(self, mosaic: RawMosaic, time: float, opened: float) -> None:
        """Send a frame, in the transfers that the host has set up."""
        port, memory = self._live(), self._memory
        self._block += 1
        strikes = self._plan.strike(self._identity.serial, "Frame", _OF_FRAMES)
        faults = {fault.kind: fault for fault in strikes}
        if not memory.stream(Sirm.CONTROL) & 1 or Kind.TIMEOUT in faults:
            return
        if len(port.queue(STREAM_IN)) > BUFFER:
            return  # The host does not keep up: it sees a gap in the numbers of the frames.
        if Kind.STALL in faults:
            port.halt(STREAM_IN)
            return
        stamp = self.oscillator.nanoseconds(opened)
        image = frames.frame(memory, mosaic, self._camera.body.sensor.bit_depth, time)
        kind = IMAGE | (CHUNKS if image.chunked else 0)
        place = (image.code, image.width, image.height, image.left, image.top)
        leader, payload = Leader(self._block, kind, stamp, *place), image.payload
        if unplug := faults.get(Kind.UNPLUG):
            port.unplug_at(max(unplug.count, 1), unplug.seconds)
        port.send(STREAM_IN, leader.pack())
        height = leader.height
        if fewer := faults.get(Kind.FEWER_ROWS):
            payload, height = payload[: len(payload) * fewer.count // height], fewer.count
        whole = len(payload)
        if dropped := faults.get(Kind.DROPPED_PAYLOAD):
            payload = payload[: max(whole - dropped.count, 0)]
        self._send_payload(port, payload)
        if Kind.NO_TRAILER not in faults:
            port.send(STREAM_IN, Trailer(self._block, 0, whole, height).pack())

    def _send_payload(self, port: Port, payload: bytes) -> None:
        memory = self._memory
        size, count = memory.stream(Sirm.TRANSFER_SIZE), memory.stream(Sirm.TRANSFER_COUNT)
        needed = -(-len(payload) // size) if size else 0
        sizes = [size] * min(count, needed)
        sizes += [memory.stream(Sirm.LAST_TRANSFER), memory.stream(Sirm.LAST_TRANSFER_2)]
        start = 0
        for size in sizes:
            part = payload[start : start + size]
            start += size
            if part and len(part) == size:
                port.send_open(STREAM_IN, part)
            elif part:
                port.send(STREAM_IN, part)

    def _refresh(self) -> None:
        body = self._camera.body
        payload = frames.refresh(self._memory, body.cfa, body.sensor.black, body.sensor.bit_depth)
        self._memory.require(payload)

    def _start_anew(self) -> DeviceMemory:
        """Memory as it is when power comes on."""
        self._checks, identity = checks_of(self._camera), self._identity
        names = {
            Abrm.MANUFACTURER: identity.make,
            Abrm.MODEL: identity.model,
            Abrm.DEVICE_VERSION: "1",
            Abrm.SERIAL: identity.serial,
        }
        memory = DeviceMemory(names, description_of(self._camera, _USB))
        power_on(self._camera, memory)
        return memory
