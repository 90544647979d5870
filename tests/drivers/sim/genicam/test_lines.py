"""Trigger wires between simulated machine vision cameras, and the clocks that they have of their own."""

import numpy as np
import pytest

from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.genicam.lines import Oscillator, Wire
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.u3v import U3vCamera
from imaging.optics.exposure import Exposure

Edge = tuple[float, int, bool]


class Ear(U3vDevice):
    """Writes down the edges on its lines."""

    def __init__(self, camera: SimulatedCamera, clock: VirtualClock) -> None:
        super().__init__(camera, clock)
        self.clock = clock
        self.heard: list[Edge] = []

    def line(self, number: int, rising: bool = True) -> None:
        self.heard.append((self.clock.now(), number, rising))
        super().line(number, rising)


@pytest.fixture(scope="module")
def rig() -> SimulatedRig:
    return simulate("toy", cameras=4, seed=5)


def ears(rig: SimulatedRig, clock: VirtualClock) -> list[Ear]:
    grey = np.full((48, 64, 3), 0.1, np.float32)
    return [Ear(SimulatedCamera(body, lambda frame: grey), clock) for body in rig.bodies]


def test_an_edge_reaches_all_others_10_to_60_us_late_each_at_its_own(rig: SimulatedRig) -> None:
    stories = []
    for seed in (5, 5, 6):
        clock = VirtualClock()
        devices, wire = ears(rig, clock), Wire(clock, seed)
        for device in devices[:3]:
            wire.connect(device, 2)
        wire.edge(True, devices[0])
        clock.sleep(1.0)
        wire.edge(False, devices[0])
        clock.sleep(1.0)
        assert devices[0].heard == devices[3].heard == []
        late = []
        for device in devices[1:3]:
            (up, line, rising), (down, other, falling) = device.heard
            assert (line, other, rising, falling) == (2, 2, True, False)
            assert down - 1.0 == pytest.approx(up)
            assert 10e-6 <= up <= 60e-6
            late.append(up)
        assert late[0] != late[1]
        stories.append(late)
    assert stories[0] == stories[1] != stories[2]


def test_an_output_is_high_for_as_long_as_the_exposure_and_a_chain_goes_on(rig: SimulatedRig) -> None:
    clock = VirtualClock()
    bus = VirtualBus(clock)
    devices, first, second = ears(rig, clock), Wire(clock), Wire(clock)
    for device in devices:
        bus.plug(device)
    first.connect(devices[0], 1)
    first.connect(devices[1], 0)
    second.connect(devices[1], 1)
    second.connect(devices[2], 0)
    cameras = [U3vCamera(device.serial, bus, clock) for device in devices]
    cameras[0].drive("Line1")
    cameras[1].listen("Line0")
    cameras[1].drive("Line1")
    cameras[2].listen("Line0")
    for camera in cameras:
        camera.set_exposure(Exposure(time=1 / 4, iso=100))
        camera.arm()
    for camera in cameras:
        camera.trigger()
    for camera in cameras:
        camera.collect()
    for device in devices[1:3]:
        (up, _, rising), (down, _, falling) = device.heard
        assert (rising, falling) == (True, False)
        assert down - up == pytest.approx(0.25)
        assert device.opened == [up]
    opened = [device.opened[0] for device in devices]
    assert 10e-6 <= opened[1] - opened[0] <= 60e-6
    assert 10e-6 <= opened[2] - opened[1] <= 60e-6
    # The fourth is on no wire and has its own trigger.
    assert devices[3].heard == []


def test_an_exposure_that_is_stopped_lets_its_line_go(rig: SimulatedRig) -> None:
    clock = VirtualClock()
    bus, wire = VirtualBus(clock), Wire(clock)
    leader, listener = ears(rig, clock)[:2]
    bus.plug(leader)
    wire.connect(leader, 1)
    wire.connect(listener, 0)
    camera = U3vCamera(leader.serial, bus, clock)
    camera.drive("Line1")
    for _ in range(2):
        camera.set_exposure(Exposure(time=30, iso=100))
        camera.arm()
        camera.trigger()
        clock.sleep(1.0)
    camera.arm()
    assert [rising for _, _, rising in listener.heard] == [True, False, True, False]
    for rise, fall in ((0, 1), (2, 3)):
        assert 0.9 < listener.heard[fall][0] - listener.heard[rise][0] < 1.5


def test_every_device_has_a_clock_of_its_own() -> None:
    clocks = [Oscillator.of(seed, serial) for seed in range(20) for serial in ("A", "B")]
    assert len(set(clocks)) == 40
    assert Oscillator.of(3, "A") == Oscillator.of(3, "A")
    assert all(0 <= one.offset <= 36_000 and abs(one.drift) <= 1e-4 for one in clocks)
    one = Oscillator(offset=3600.0, drift=50e-6)
    assert one.nanoseconds(0.0) == 3600 * 10**9
    assert one.nanoseconds(1000.0) - one.nanoseconds(0.0) == 1_000_050_000_000
