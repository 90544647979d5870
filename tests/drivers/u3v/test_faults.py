"""Everything that can go wrong with a USB3 Vision camera ends in a frame that is right, or in our errors."""

import contextlib
import random

import numpy as np
import pytest

from drivers.errors import CameraBusy, CameraLost, CameraProtocol, CameraTimeout
from drivers.sim.faults import ROUGH, Fault, FaultPlan, Kind
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.u3v import U3vCamera
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure

from .conftest import Bench, MakeBench
from .test_camera import LABEL, shoot


def right(bench: Bench, camera: U3vCamera) -> bool:
    """Return whether the next shot equals that of the camera without USB at the same take."""
    return np.array_equal(shoot(camera).pixels, shoot(bench.twin).pixels)


@pytest.mark.parametrize("operation", ["ReadMem", "WriteMem"])
@pytest.mark.parametrize("nth", [1, 3, 14])
@pytest.mark.parametrize(
    "fault",
    [
        Fault(Kind.BUSY, seconds=0.1),
        Fault(Kind.BUSY, count=3),
        Fault(Kind.STALL),
        Fault(Kind.TIMEOUT),
        Fault(Kind.TRUNCATED, count=5),
        Fault(Kind.TRUNCATED, count=0),
        Fault(Kind.WRONG_TRANSACTION),
        Fault(Kind.CORRUPT_LENGTH, count=3),
        Fault(Kind.UNPLUG, count=7, seconds=1.5),
    ],
    ids=str,
)
def test_one_fault_of_the_control_channel_is_got_over(
    make_bench: MakeBench, fault: Fault, operation: str, nth: int
) -> None:
    bench = make_bench(faults=[Fault(fault.kind, "*", operation, nth, fault.seconds, fault.count)])
    camera = bench.camera()
    camera._was_open = True  # As after a first opening: it may come back.
    assert right(bench, camera)
    assert len(bench.plan.log) == 1


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (Fault(Kind.NO_TRAILER, operation="Frame"), "trailer is missing|did not come"),
        (Fault(Kind.DROPPED_PAYLOAD, operation="Frame", count=1), "1 bytes of its payload are missing"),
        (Fault(Kind.DROPPED_PAYLOAD, operation="Frame", count=1000), "1000 bytes"),
        (Fault(Kind.DROPPED_PAYLOAD, operation="Frame", count=10**6), "bytes of its payload are missing"),
        (
            Fault(Kind.FEWER_ROWS, operation="Frame", count=30),
            r"after 30 of 48 rows \(variable height\)",
        ),
        (Fault(Kind.STALL, operation="Frame"), "halted"),
        (Fault(Kind.TIMEOUT, operation="Frame"), "sent no frame"),
    ],
    ids=str,
)
def test_an_incomplete_frame_is_reported_and_the_next_is_right(
    make_bench: MakeBench, fault: Fault, message: str
) -> None:
    bench = make_bench(faults=[fault])
    camera = bench.camera()
    with pytest.raises((CameraProtocol, CameraTimeout), match=message):
        shoot(camera)
    shoot(bench.twin)
    assert right(bench, camera)


def test_busy_for_too_long_is_said(make_bench: MakeBench) -> None:
    bench = make_bench(faults=[Fault(Kind.BUSY, operation="WriteMem", seconds=5.0)])
    camera = bench.camera()
    with pytest.raises(CameraBusy, match="busy"):
        camera.set_exposure(LABEL)
    assert bench.clock.now() < 1.0


@pytest.mark.parametrize("count", [1, 52, 60, 3000])
def test_unplugged_in_a_frame_it_is_found_again(make_bench: MakeBench, count: int) -> None:
    bench = make_bench(faults=[Fault(Kind.UNPLUG, operation="Frame", seconds=2.0, count=count)])
    camera = bench.camera()
    with pytest.raises(CameraLost):
        shoot(camera)
    address = bench.bus._address
    shoot(bench.twin)
    # It was set up anew; the exposure that was wanted is set again without being asked for.
    camera.arm()
    camera.trigger()
    frame = camera.collect()
    assert bench.bus._address == address + 1
    assert np.array_equal(frame.pixels, shoot(bench.twin).pixels)


def test_a_camera_that_stays_away_is_lost_and_not_waited_for_without_end(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera()
    shoot(camera)
    bench.bus.unplug(bench.serial)
    with pytest.raises(CameraError, match="plug"):
        camera.set_exposure(LABEL)
    assert bench.clock.now() < 15


@pytest.mark.parametrize(
    "fault",
    [
        Fault(Kind.NO_TRAILER, operation="Frame", nth=2),
        Fault(Kind.TIMEOUT, operation="Frame", nth=3),
        Fault(Kind.UNPLUG, operation="Frame", nth=1, count=500, seconds=1.0),
        Fault(Kind.BUSY, operation="WriteMem", nth=30, seconds=3.0),
    ],
    ids=str,
)
def test_a_bracket_that_breaks_off_leaves_no_trace(make_bench: MakeBench, fault: Fault) -> None:
    bench = make_bench(faults=[fault])
    camera = bench.camera()
    exposures = [LABEL.with_time(2.0**power) for power in (-9, -6, -4)]
    with pytest.raises(CameraError):
        camera.bracket(exposures)
    assert len(bench.plan.log) == 1
    bench.clock.sleep(5.0)
    frame = shoot(camera)
    assert frame.metadata.exposure == LABEL.with_time(2.0**-6)
    assert frame.pixels.mean() == pytest.approx(shoot(bench.twin).pixels.mean(), rel=0.01)
    frames = camera.bracket(exposures)
    assert [one.metadata.exposure for one in frames] == exposures


@pytest.mark.parametrize("seed", [1, 2])
def test_many_shots_over_a_rough_bus_are_right(make_bench: MakeBench, seed: int) -> None:
    """A twentieth of all commands and frames goes wrong, unplugging included."""
    bench = make_bench()
    bench.plan.mix, bench.plan.seed = ROUGH, seed
    camera = bench.camera()
    for shot in range(35):
        exposure = Exposure(time=2.0 ** (-9 + shot % 7), iso=100)
        frame = None
        for _ in range(10):
            with contextlib.suppress(CameraError):
                frame = shoot(camera, exposure)
                break
        assert frame is not None
        assert frame.metadata.exposure == exposure
        # The take that was right may be a later one of the sensor's: another noise, the same light.
        assert frame.pixels.mean() == pytest.approx(shoot(bench.twin, exposure).pixels.mean(), rel=0.01)
    struck = {one.fault.kind for one in bench.plan.log}
    assert {Kind.BUSY, Kind.STALL} <= struck
    assert len(bench.plan.log) > 15


class Babbler(U3vDevice):
    """Answers some commands with random bytes."""

    dice: random.Random
    share = 1.0

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        if self.dice.random() >= self.share:
            super().on_bulk_out(endpoint, packet)
            return
        length = self.dice.choice((0, 3, 12, 16, 20, 76, 1024))
        data = bytearray(self.dice.randbytes(length))
        if length >= 12 and self.dice.random() < 0.8:
            # Often a header that is right, as far as it goes.
            data[:12] = packet[:4] + bytes(2) + bytes((packet[6] | 1, packet[7])) + packet[8:12]
            data[8:10] = (length - 12).to_bytes(2, "little")
        self._live().send(0x81, bytes(data))


@pytest.mark.parametrize("share", [1.0, 0.3, 0.05])
@pytest.mark.parametrize("seed", range(8))
def test_random_answers_give_only_our_errors(make_bench: MakeBench, seed: int, share: float) -> None:
    twin = make_bench().twin
    clock = VirtualClock()
    bus = VirtualBus(clock)
    device = Babbler(twin, clock, FaultPlan(clock))
    device.dice, device.share = random.Random(seed), share
    bus.plug(device)
    camera = U3vCamera(twin.body.serial, bus, clock)
    with contextlib.suppress(CameraError):
        shoot(camera)
    camera.close()
    assert clock.now() < 120
