"""A bus of packet queues behind pyusb, its clock, and scripted PTP responders: plain, Nikon, Canon, Sony."""

import errno
import heapq
import itertools
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import usb.backend
import usb.core

from drivers.ptp.codec import Command, Data, Header, Response, parse
from drivers.ptp.codes import Operation, ResponseCode
from drivers.usb import STILL_IMAGE, UsbPipe, find

MPS = 512
OUT, IN, INTERRUPT = 0x02, 0x81, 0x83

Script = Callable[[Command, bytes], list[bytes]]


class FakeClock:
    """Seconds that pass only by sleeping; what is due meanwhile happens in its order."""

    def __init__(self) -> None:
        self.time = 0.0
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = itertools.count()

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.until(lambda: False, seconds)

    def later(self, seconds: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._due, (self.time + seconds, next(self._numbers), action))

    def until(self, ready: Callable[[], bool], seconds: float) -> bool:
        end = self.time + seconds
        while not ready():
            if not self._due or self._due[0][0] > end:
                self.time = end
                return False
            moment, _, action = heapq.heappop(self._due)
            self.time = max(self.time, moment)
            action()
        return True


def failure(number: int) -> usb.core.USBError:
    kind = usb.core.USBTimeoutError if number == errno.ETIMEDOUT else usb.core.USBError
    return kind("scripted", None, number)


class FakeDevice:
    """One device: packets out are given to `received`, packets in and events wait in queues."""

    def __init__(
        self,
        clock: FakeClock,
        received: Callable[["FakeDevice", bytes], None],
        *,
        vendor: int = 0x1234,
        serial: str = "A1",
        mps: int = MPS,
    ) -> None:
        self.clock, self.received = clock, received
        self.vendor, self.serial, self.mps, self.address = vendor, serial, mps, 1
        self.queues: dict[int, deque[bytes]] = {IN: deque(), INTERRUPT: deque()}
        self.halted: set[int] = set()
        self.present = True
        self.status: tuple[int, tuple[int, ...]] = (0x2001, ())
        self.clears = self.controls = True
        self.log: list[Any] = []

    def send(self, transfer: bytes, endpoint: int = IN, *, zlp: bool = True, size: int | None = None) -> None:
        """Queue a transfer as packets, with the zero-length packet that ends one of whole packets."""
        size = size or self.mps
        packets = [transfer[at : at + size] for at in range(0, len(transfer), size)]
        self.queues[endpoint].extend(packets)
        if zlp and len(transfer) % size == 0:
            self.queues[endpoint].append(b"")

    def read(self, endpoint: int, buffer: Any, timeout: int) -> int:
        self.check(endpoint)
        queue = self.queues[endpoint]
        self.clock.until(lambda: bool(queue) or not self.present or endpoint in self.halted, timeout / 1000)
        self.check(endpoint)
        if not queue:
            raise failure(errno.ETIMEDOUT)
        filled = 0
        while queue and filled < len(buffer):
            packet = queue.popleft()
            if len(packet) > len(buffer) - filled:
                raise failure(errno.EOVERFLOW)
            buffer[filled : filled + len(packet)] = type(buffer)("B", packet)
            filled += len(packet)
            if len(packet) < self.mps:
                break
        return filled

    def check(self, endpoint: int) -> None:
        if not self.present:
            raise failure(errno.ENODEV)
        if endpoint in self.halted:
            raise failure(errno.EPIPE)

    def control(self, kind: int, request: int, data: Any) -> int:
        if not self.present:
            raise failure(errno.ENODEV)
        if not self.controls:
            raise failure(errno.EPIPE)
        self.log.append((request, bytes(data)))
        if request == 0x67:
            code, ends = self.status
            answer = (4 + 4 * len(ends)).to_bytes(2, "little") + code.to_bytes(2, "little")
            answer += b"".join(end.to_bytes(4, "little") for end in ends)
            data[: len(answer)] = type(data)("B", answer)
            return len(answer)
        if request in (0x64, 0x66):
            self.queues[IN].clear()
            if request == 0x66:
                self.received(self, b"reset")
            return len(data)
        raise failure(errno.EPIPE)


class FakeBus(usb.backend.IBackend):
    """What pyusb asks of a backend."""

    def __init__(self, *devices: FakeDevice) -> None:
        self.devices = list(devices)
        self.opened = 0

    def enumerate_devices(self) -> Any:
        return iter([device for device in self.devices if device.present])

    def get_parent(self, device: FakeDevice) -> None:
        return None

    def get_device_descriptor(self, device: FakeDevice) -> Any:
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=1,
            bcdUSB=0x200,
            bDeviceClass=0,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=device.vendor,
            idProduct=0x5678,
            bcdDevice=1,
            iManufacturer=0,
            iProduct=0,
            iSerialNumber=3,
            bNumConfigurations=1,
            address=device.address,
            bus=1,
            port_number=1,
            port_numbers=(1,),
            speed=3,
        )

    def get_configuration_descriptor(self, device: FakeDevice, number: int) -> Any:
        if number:
            raise IndexError
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=2,
            wTotalLength=39,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0xC0,
            bMaxPower=1,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, device: FakeDevice, number: int, other: int, config: int) -> Any:
        if number or other or config:
            raise IndexError
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=4,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=3,
            bInterfaceClass=6,
            bInterfaceSubClass=1,
            bInterfaceProtocol=1,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(
        self, device: FakeDevice, number: int, interface: int, other: int, config: int
    ) -> Any:
        address, attributes, size = ((OUT, 2, device.mps), (IN, 2, device.mps), (INTERRUPT, 3, 24))[number]
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=5,
            bEndpointAddress=address,
            bmAttributes=attributes,
            wMaxPacketSize=size,
            bInterval=1,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, device: FakeDevice) -> FakeDevice:
        if not device.present:
            raise failure(errno.ENODEV)
        self.opened += 1
        return device

    def close_device(self, device: FakeDevice) -> None:
        self.opened -= 1

    def get_configuration(self, device: FakeDevice) -> int:
        return 1

    def claim_interface(self, device: FakeDevice, number: int) -> None: ...

    def release_interface(self, device: FakeDevice, number: int) -> None: ...

    def reset_device(self, device: FakeDevice) -> None:
        device.check(0)

    def is_kernel_driver_active(self, device: FakeDevice, number: int) -> bool:
        return False

    def bulk_write(self, device: FakeDevice, endpoint: int, number: int, data: Any, timeout: int) -> int:
        device.check(endpoint)
        device.received(device, bytes(data))
        return len(data)

    def bulk_read(self, device: FakeDevice, endpoint: int, number: int, buffer: Any, timeout: int) -> int:
        return device.read(endpoint, buffer, timeout)

    def intr_read(self, device: FakeDevice, endpoint: int, number: int, buffer: Any, timeout: int) -> int:
        return device.read(endpoint, buffer, timeout)

    def clear_halt(self, device: FakeDevice, endpoint: int) -> None:
        if not device.present:
            raise failure(errno.ENODEV)
        device.log.append(("clear", endpoint))
        if device.clears:
            device.halted.discard(endpoint)

    def ctrl_transfer(
        self, device: FakeDevice, kind: int, request: int, value: int, index: int, data: Any, timeout: int
    ) -> int:
        if (kind, request) == (0x80, 6) and value >> 8 == 3:
            text = device.serial.encode("utf-16-le") if value & 0xFF else b"\x09\x04"
            answer = bytes((len(text) + 2, 3)) + text
            count = min(len(answer), len(data))
            data[:count] = type(data)("B", answer[:count])
            return count
        return device.control(kind, request, data)


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


class Scripted:
    """A responder that does for each operation what `script` says, in packets, and remembers what it got.

    A script is called with the command and its data, and gives transfers to send: what a faulty camera
    would send is as easily said as what a sound one would.
    """

    def __init__(self, clock: FakeClock, *, mps: int = MPS) -> None:
        self.device = FakeDevice(clock, self.received, mps=mps)
        self.bus = FakeBus(self.device)
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

    def received(self, device: FakeDevice, packet: bytes) -> None:
        if packet == b"reset":
            self.resets += 1
            self.on_reset()
            self._buffer, self._waiting = b"", None
            return
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
        left = list(scripts)
        return lambda command, data: (left.pop(0) if len(left) > 1 else left[0])(command, data)


@pytest.fixture
def scripted(clock: FakeClock) -> Scripted:
    return Scripted(clock)


@pytest.fixture(scope="session")
def new_scripted() -> Callable[[], Scripted]:
    """For tests that need one an example."""
    return lambda: Scripted(FakeClock())
