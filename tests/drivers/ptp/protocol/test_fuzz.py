"""Cameras that send anything at all: only CameraErrors come of it, in bounded time."""

import random
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from drivers.ptp import find_cameras
from drivers.ptp.protocol.codec import Command, Data, Event, Response
from drivers.ptp.protocol.codes import (
    CanonOperation,
    DataType,
    Operation,
    ResponseCode,
    SonyOperation,
    VendorId,
)
from drivers.ptp.protocol.datasets import DeviceInfo, DevicePropDesc, EnumForm, ObjectInfo
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure

OUT, IN, INTERRUPT = 0x02, 0x81, 0x83
MOST_SECONDS = 600.0
"""Seconds of the clock for one call; the longest are a shot that never comes, and time-outs in a row."""
MOST_COMMANDS = 20_000
"""For one call: a shot is asked for 20 times a second."""

ANY_OPERATION = (
    *range(0x1001, 0x101D),
    *range(0x9101, 0x9130),
    *range(0x90C0, 0x90CC),
    *range(0x9201, 0x920D),
)
TAKES_DATA = {
    Operation.SET_DEVICE_PROP_VALUE,
    CanonOperation.SET_DEVICE_PROP_VALUE_EX,
    SonyOperation.SET_CONTROL_A,
}
INFOS = {
    vendor: DeviceInfo(
        vendor_extension=vendor,
        operations=ANY_OPERATION,
        properties=(0x5003, 0x5004, 0x5007, 0x500D, 0x500F, 0xD100, 0xD10B, 0xD0B4),
        serial="A1",
    )
    for vendor in (VendorId.MICROSOFT, VendorId.NIKON, VendorId.CANON, VendorId.SONY)
}
CODES = (*ResponseCode, *ResponseCode, 0, 0x2FFF, 0xFFFF)


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy")


class Liar:
    """Answers in the right shape, except for a share of lies: bytes, codes, halts and silence at random."""

    def __init__(self, scripted: Any, vendor: VendorId, seed: int) -> None:
        self.scripted, self.device, self.info = scripted, scripted.device, INFOS[vendor]
        self.dice = random.Random(seed)
        self.lies = self.dice.choice((0.0, 0.02, 0.1, 0.5, 1.0))
        scripted.default, scripted.sends_data = self.answer, TAKES_DATA

    def bytes(self, most: int) -> bytes:
        return self.dice.randbytes(self.dice.randint(0, most))

    def shaped(self, command: Command) -> bytes:
        """A payload of the right shape with any content."""
        dice = self.dice
        if command.code == Operation.GET_DEVICE_INFO:
            return self.info.pack()
        if command.code == Operation.GET_DEVICE_PROP_DESC:
            values = tuple(dice.randint(0, 255) for _ in range(dice.randint(1, 5)))
            code, current = command.parameters[0], dice.choice(values)
            return DevicePropDesc(code, DataType.UINT16, True, 1, current, EnumForm(values)).pack()
        if command.code == Operation.GET_OBJECT_INFO:
            name = dice.choice(("a.dng", "a.jpg", "", "a.txt"))
            return ObjectInfo(size=dice.randint(0, 5000), filename=name).pack()
        if command.code == Operation.GET_OBJECT_HANDLES:
            handles = range(dice.randint(0, 4))
            return b"".join(one.to_bytes(4, "little") for one in (len(handles), *handles))
        if command.code in (Operation.GET_OBJECT, Operation.GET_PARTIAL_OBJECT):
            return dice.randbytes(min(command.parameters[-1], 5000))
        return self.bytes(64) if dice.random() < 0.5 else b""

    def answer(self, command: Command, sent: bytes) -> list[bytes]:
        dice = self.dice
        self.disturb()
        body = [] if command.code in TAKES_DATA else [Data(command.code, command.transaction, b"").pack()]
        if dice.random() >= self.lies:
            body = [Data(command.code, command.transaction, self.shaped(command)).pack()] if body else []
            return [*body, *self.scripted.ok(command)]
        match dice.randrange(6):
            case 0:
                return [self.bytes(dice.choice((11, 40, 1024))) for _ in range(dice.randint(0, 4))]
            case 1:
                return [Response(dice.choice(CODES), command.transaction).pack()]
            case 2:
                self.device.port.halt(dice.choice((IN, OUT)))
                return []
            case 3:
                return []
            case 4:
                cut = Data(command.code, command.transaction, self.shaped(command)).pack()
                return [cut[: dice.randint(0, len(cut))], *self.scripted.ok(command)]
            case _:
                return [
                    Data(command.code, command.transaction, self.bytes(80)).pack(),
                    *self.scripted.ok(command),
                ]

    def disturb(self) -> None:
        """Events and states that have nothing to do with what was asked."""
        dice, device = self.dice, self.device
        if dice.random() < 0.2:
            code, handle = dice.choice((0x4002, 0x400D, 0x400A, 0xC101)), dice.randint(0, 9)
            device.send(Event(code, 1, (handle,)).pack(), INTERRUPT)
        if dice.random() < self.lies / 4:
            device.send(self.bytes(24), INTERRUPT)
            device.status = (dice.choice(CODES), dice.choice(((), (IN,), (OUT, IN), (7, 8))))
            device.controls = dice.random() < 0.8
            if dice.random() >= 0.95:
                device.port.unplug()


@pytest.mark.parametrize("vendor", INFOS)
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32))
@example(seed=0)
def test_anything_sent_is_survived(new_scripted: Any, vendor: VendorId, seed: int) -> None:
    scripted = new_scripted()
    Liar(scripted, vendor, seed)
    clock = scripted.device.clock
    camera = find_cameras(scripted.bus, clock)[0]
    for step in (
        camera.identify,
        camera.capabilities,
        lambda: camera.set_exposure(Exposure(time=1 / 60, f_number=4.0, iso=100.0)),
        camera.arm,
        camera.trigger,
        camera.collect,
        camera.close,
    ):
        before = clock.now()
        scripted.commands.clear()
        try:
            step()
        except CameraError:
            if not scripted.device.present:
                scripted.device.plug()
        assert clock.now() - before < MOST_SECONDS
        assert len(scripted.commands) < MOST_COMMANDS
    assert scripted.bus.open_handles == 0


@pytest.mark.parametrize("name", PROFILES)
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32), share=st.sampled_from([0.01, 0.05, 0.3]))
@example(seed=0, share=0.05)
def test_sound_cameras_on_a_damaged_wire(toy: SimulatedRig, name: str, seed: int, share: float) -> None:
    """Flipped, cut and doubled bytes from a simulated camera of each make, at any point of a shot."""
    dice, clock = random.Random(seed), VirtualClock()
    bus = VirtualBus(clock)
    body = SimulatedCamera(toy.bodies[0], lambda frame: toy.radiance(0, frame))
    port = bus.plug(PtpDevice(Responder(body, profile(name), clock)))
    sound = port.send

    def damaged(endpoint: int, data: bytes) -> None:
        if dice.random() < share:
            at = dice.randint(0, min(len(data) - 1, 60))
            match dice.randrange(4):
                case 0:
                    data = data[:at] + dice.randbytes(1) + data[at + 1 :]
                case 1:
                    data = data[:at]
                case 2:
                    data = data[:at] + data
                case _:
                    data = data[:at] + dice.randbytes(4) + data[at + 4 :]
        sound(endpoint, data)

    port.send = damaged  # type: ignore[method-assign]
    camera = find_cameras(bus, clock)[0]
    for _ in range(2):
        before = clock.now()
        try:
            camera.set_exposure(Exposure(time=1 / 60, f_number=4.0, iso=100.0))
            camera.arm()
            camera.trigger()
            camera.collect()
        except CameraError:
            pass
        assert clock.now() - before < MOST_SECONDS
    camera.close()
    assert bus.open_handles == 0
