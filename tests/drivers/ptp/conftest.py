"""Scripted PTP responders on the virtual bus, which send whatever a faulty camera might."""

from collections.abc import Callable
from typing import Any

import pytest

from drivers.ptp.protocol.codec import Command, Data, Header, Response, parse
from drivers.ptp.protocol.codes import Operation, ResponseCode
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.descriptors import Description, Endpoint, Interface
from drivers.sim.usb.port import Port, Setup, Stall
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.usb import STILL_IMAGE, UsbPipe, find

OUT, IN, INTERRUPT = 0x02, 0x81, 0x83
CANCEL, RESET, STATUS = 0x64, 0x66, 0x67

Script = Callable[[Command, bytes], list[bytes]]


class InstantBus(VirtualBus):
    """A bus whose transfers take no time, so that what passes is what was waited for."""

    def _spend(self, handle: Any, count: int) -> None:
        self._there(handle)


class ScriptedDevice:
    """One device: packets out are given to `received`, class requests are answered as its fields say.

    status: code and halted endpoints that it tells. clears: whether clearing a halt helps. controls: whether
    it knows class requests. log: requests and cleared endpoints.
    """

    def __init__(
        self, clock: VirtualClock, received: Callable[[bytes], None], on_reset: Callable[[], None]
    ) -> None:
        self.clock, self.received, self.on_reset_request = clock, received, on_reset
        self.bus = InstantBus(clock)
        self.status: tuple[int, tuple[int, ...]] = (ResponseCode.OK, ())
        self.clears = self.controls = True
        self.log: list[Any] = []
        self.plug()

    def plug(self, packet: int = 512) -> None:
        """Plug it in, with packets of that many bytes."""
        self.packet = packet
        self.port = self.bus.plug(self)

    @property
    def present(self) -> bool:
        return not self.port.gone

    def send(self, transfer: bytes, endpoint: int = IN, *, zlp: bool = True) -> None:
        """Queue a transfer, with the zero-length packet that ends one of whole packets."""
        if zlp and endpoint == IN:
            self.port.send(endpoint, transfer)
        else:
            self.port.send_open(endpoint, transfer)

    @property
    def description(self) -> Description:
        pipes = (
            Endpoint(OUT, "bulk", self.packet),
            Endpoint(IN, "bulk", self.packet),
            Endpoint(INTERRUPT, "interrupt", 24),
        )
        return Description(0x1234, 0x5678, ("", "", "A1"), (Interface(0, (6, 1, 1), pipes),))

    def on_attach(self, port: Port) -> None: ...

    def on_reset(self) -> None: ...

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        self.received(packet)

    def on_clear_halt(self, endpoint: int) -> None:
        self.log.append(("clear", endpoint))
        if not self.clears:
            self.port.halt(endpoint)

    def on_control(self, setup: Setup, data: bytes) -> bytes:
        if not self.controls or setup.request not in (CANCEL, RESET, STATUS):
            raise Stall
        self.log.append((setup.request, data))
        if setup.request == STATUS:
            code, ends = self.status
            head = (4 + 4 * len(ends)).to_bytes(2, "little") + code.to_bytes(2, "little")
            return head + b"".join(end.to_bytes(4, "little") for end in ends)
        self.port.queue(IN).clear()
        if setup.request == RESET:
            self.on_reset_request()
        return b""


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


class Scripted:
    """A responder that does for each operation what `script` says, in packets, and remembers what it got.

    A script is called with the command and its data, and gives transfers to send.
    """

    def __init__(self, clock: VirtualClock) -> None:
        self.device = ScriptedDevice(clock, self.received, self.reset)
        self.bus = self.device.bus
        self.scripts: dict[int, Script] = {}
        self.commands: list[Command] = []
        self.data: list[bytes] = []
        self.zero_length = 0
        self.resets = 0
        self.on_reset: Callable[[], None] = lambda: None
        self._buffer = b""
        self._waiting: Command | None = None
        self.default: Script = self.ok
        self.sends_data: set[int] = {Operation.SET_DEVICE_PROP_VALUE}

    def pipe(self) -> UsbPipe:
        return find(STILL_IMAGE, self.bus)[0].open()

    def reset(self) -> None:
        self.resets += 1
        self.on_reset()
        self._buffer, self._waiting = b"", None

    def received(self, packet: bytes) -> None:
        if not packet:
            self.zero_length += 1
            return
        self._buffer += packet
        if len(self._buffer) < Header.unpack(self._buffer).length:
            return
        container, self._buffer = parse(self._buffer), b""
        if isinstance(container, Command):
            self.commands.append(container)
            if container.code in self.sends_data:
                self._waiting = container
            else:
                self.answer(container, b"")
        elif isinstance(container, Data) and self._waiting is not None:
            self.data.append(container.payload)
            self.answer(self._waiting, container.payload)

    def answer(self, command: Command, data: bytes) -> None:
        script = self.scripts.get(command.code, self.default)
        for transfer in script(command, data):
            self.device.send(transfer)

    @staticmethod
    def ok(command: Command, data: bytes = b"") -> list[bytes]:
        """The end of a transaction that went well."""
        return [Response(ResponseCode.OK, command.transaction).pack()]

    @classmethod
    def sends(cls, payload: bytes) -> Script:
        """A script that answers with data."""
        return lambda command, _: [
            Data(command.code, command.transaction, payload).pack(),
            *cls.ok(command),
        ]

    @staticmethod
    def says(code: int) -> Script:
        """A script that answers with a response code."""
        return lambda command, _: [Response(code, command.transaction).pack()]

    @staticmethod
    def each(*scripts: Script) -> Script:
        """One script after the other, the last one for ever."""
        remaining = list(scripts)
        return lambda command, data: (remaining.pop(0) if len(remaining) > 1 else remaining[0])(command, data)


@pytest.fixture
def scripted(clock: VirtualClock) -> Scripted:
    return Scripted(clock)


@pytest.fixture(scope="session")
def new_scripted() -> Callable[[], Scripted]:
    """For tests that need one an example."""
    return lambda: Scripted(VirtualClock())
