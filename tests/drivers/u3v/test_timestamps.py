"""A camera's own clock: hours off and drifting, and still the shutter's moment comes out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.errors import CameraRefused
from drivers.genicam import camera as camera_module
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.timestamps import Latch, Opening, latch, opening
from drivers.sim.genicam.lines import Oscillator
from drivers.sim.genicam.memory import Denied
from drivers.u3v.gencp import Status
from drivers.u3v.registers import read_xml
from imaging.optics.exposure import Exposure

from .conftest import MakeBench
from .test_camera import LABEL, shoot


@pytest.fixture
def openings(monkeypatch: pytest.MonkeyPatch) -> list[Opening | None]:
    """Openings by the driver for each stamp, uncertainty and all."""
    noted: list[Opening | None] = []

    def spy(*given: Any) -> Opening | None:
        noted.append(opening(*given))
        return noted[-1]

    monkeypatch.setattr(camera_module, "opening", spy)
    return noted


@pytest.mark.parametrize("offset", [0.0, 7 * 3600.0, 3e7])
@pytest.mark.parametrize("drift", [-100e-6, 0.0, 50e-6])
def test_the_moment_is_right_within_what_is_said(
    make_bench: MakeBench, openings: list[Opening | None], offset: float, drift: float
) -> None:
    bench = make_bench()
    bench.device.oscillator = Oscillator(offset, drift)
    camera = bench.camera()
    for time, waited in ((1 / 1000, 0.0), (1 / 60, 3.0), (30.0, 20.0)):
        camera.set_exposure(Exposure(time=time, iso=100))
        camera.arm()
        bench.clock.sleep(waited)  # as long as other cameras take to be armed
        camera.trigger()
        stated, truth, estimated = camera.collect().metadata.opened, bench.device.opened[-1], openings[-1]
        assert estimated is not None
        assert stated == estimated.time
        assert abs(estimated.time - truth) <= estimated.uncertainty < 250e-6


class NoClock:
    """The bootstrap registers of a device that keeps its clock elsewhere."""

    def latch(self) -> None:
        raise CameraRefused("it has nothing at that address")

    def latched(self) -> int:
        return 0


def test_the_features_serve_where_the_registers_do_not(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera()
    camera.identify()
    session = camera._session
    assert session is not None
    by_registers = latch(session.device_clock, session.nodes, bench.clock)
    by_features = latch(NoClock(), session.nodes, bench.clock)
    device = bench.device.oscillator
    for one in (by_registers, by_features):
        assert one is not None
        shown = (1e-9 * one.device - device.offset) / (1 + device.drift)
        assert abs(shown - one.host) <= one.uncertainty < 250e-6
    assert by_registers != by_features
    xml = read_xml(session.control, session.bootstrap.manifest).replace(b"TimestampLatch", b"Vendors")
    assert latch(NoClock(), NodeMap(xml, session.control, "it"), bench.clock) is None


@pytest.mark.parametrize("status", [Status.BUSY, Status.TIMEOUT, Status.NOT_IMPLEMENTED, Status.BAD_HEADER])
def test_a_frame_is_not_lost_for_its_time(
    make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch, status: Status
) -> None:
    bench = make_bench()
    camera = bench.camera()
    assert shoot(camera).metadata.opened is not None

    def refuse(nanoseconds: int) -> None:
        raise Denied(status)

    monkeypatch.setattr(bench.device._memory, "latch", refuse)
    frame = shoot(camera)
    shoot(bench.twin)
    assert frame.metadata.opened is None
    assert np.array_equal(frame.pixels, shoot(bench.twin).pixels)


@pytest.mark.parametrize("stamp", [0, 1, -60_000_000_000, 60_000_000_000, (1 << 64) - 1])
def test_a_stamp_that_makes_no_sense_is_left_out(
    make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch, stamp: int
) -> None:
    """0, 1 and all ones as they are; a minute back or ahead of the right one."""
    bench = make_bench()
    camera = bench.camera()
    camera.set_exposure(LABEL)
    assert camera._session is not None
    real = camera._session.stream.next_frame

    def bent(timeout: float) -> Any:
        frame = real(timeout)
        wrong = frame.leader.timestamp + stamp if abs(stamp) == 60_000_000_000 else stamp
        return replace(frame, leader=replace(frame.leader, timestamp=wrong))

    monkeypatch.setattr(camera._session.stream, "next_frame", bent)
    camera.arm()
    camera.trigger()
    assert camera.collect().metadata.opened is None


def test_a_clock_that_is_set_back_between_gives_no_moment(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera()
    camera.set_exposure(LABEL)
    camera.arm()
    camera.trigger()
    bench.device.oscillator = Oscillator(0.0, 0.0)
    assert camera.collect().metadata.opened is None
    assert shoot(camera).metadata.opened == pytest.approx(bench.device.opened[-1], abs=250e-6)


def test_a_stamp_of_the_end_of_a_long_exposure_is_not_taken_for_its_beginning() -> None:
    before, after = Latch(10.0, 0, 1e-4), Latch(11.0, 1_000_000_000, 1e-4)
    estimated = opening(before, after, 100_000_000, exposure=0.5)
    assert estimated is not None
    assert (estimated.time, estimated.uncertainty) == (pytest.approx(10.1), pytest.approx(1e-4))
    assert opening(before, after, 600_000_000, exposure=0.5) is None
    assert opening(None, after, 100_000_000, exposure=0.5) is None
    assert opening(before, None, 100_000_000, exposure=0.5) is None
    assert opening(before, before, 0, exposure=0.0) is None
