"""A machine vision camera from end to end: what it delivers is what the sensor behind it saw."""

import numpy as np
import pytest

from drivers.camera import Camera
from drivers.errors import CameraNotFound, CameraRefused, CameraTimeout
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.pixels import BY_CODE, BY_NAME
from drivers.sim.genicam.feature_registers import Feature
from drivers.u3v import U3vCamera, find_cameras
from drivers.u3v.registers import Sirm
from drivers.u3v.session import open_session
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import BAYER, Cfa
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import raw_shot

from .conftest import Bench, MakeBench

LABEL = Exposure(time=1 / 60, iso=200)


def shoot(camera: Camera, exposure: Exposure = LABEL) -> RawMosaic:
    return raw_shot(camera, exposure)


@pytest.mark.parametrize("bits", [12, 14])
@pytest.mark.parametrize("cfa", BAYER)
def test_a_frame_is_what_the_sensor_saw(make_bench: MakeBench, bits: int, cfa: Cfa) -> None:
    bench: Bench = make_bench(bits=bits, cfa=cfa)
    camera = bench.camera()
    frame, truth = shoot(camera), shoot(bench.twin)
    camera.close()
    assert np.array_equal(frame.pixels, truth.pixels)
    assert (frame.cfa, frame.white) == (truth.cfa, truth.white)
    # The camera tells three colours, the two greens as their mean.
    pattern, black = cfa.pattern.reshape(-1), np.array(truth.black).reshape(-1)
    for site in range(4):
        assert np.ravel(frame.black)[site] == pytest.approx(black[pattern == pattern[site]].mean())
    assert frame.metadata.serial == bench.serial
    assert frame.metadata.exposure == Exposure(time=2.0**-6, iso=200)


@pytest.mark.parametrize(("bits", "name"), [(12, "Mono12p"), (14, "Mono16")])
def test_a_mono_camera_is_taken_as_it_is(make_bench: MakeBench, bits: int, name: str) -> None:
    bench: Bench = make_bench(bits=bits, cfa=Cfa.MONO)
    camera = bench.camera()
    frame, truth = shoot(camera), shoot(bench.twin)
    camera.close()
    assert BY_CODE[bench.device._memory.get(Feature.PIXEL_FORMAT)].name == name
    assert np.array_equal(frame.pixels, truth.pixels)
    assert (frame.cfa, frame.white) == (Cfa.MONO, truth.white)
    assert frame.black == ((pytest.approx(np.mean(truth.black)),),)


def test_the_exposure_is_what_is_applied(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera()
    capabilities = camera.capabilities()
    assert capabilities.times[0] == 2.0**-13
    assert capabilities.times[-1] == 32.0
    assert (capabilities.width, capabilities.height, capabilities.bit_depth) == (64, 48, 12)
    assert capabilities.isos[0] == pytest.approx(100)
    assert capabilities.isos[-1] == pytest.approx(1600)
    # A setting that is read back and set again stays.
    for wanted in (Exposure(time=1e-9, iso=1), Exposure(time=1 / 50, iso=820), Exposure(time=1e6, iso=1e6)):
        applied = camera.set_exposure(wanted)
        assert camera.set_exposure(applied) == applied
    assert applied == Exposure(time=32.0, iso=1600)
    assert camera.set_exposure(Exposure(time=1.0)).iso == 1600
    camera.close()


def test_a_long_exposure_is_waited_for_in_the_clock_of_the_bus(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera()
    camera.set_exposure(Exposure(time=30, iso=100))
    camera.arm()
    opened = camera.trigger()
    frame = camera.collect()
    assert frame.metadata.exposure == Exposure(time=32, iso=100)
    assert 32.0 < bench.clock.now() - opened < 32.1


@pytest.mark.parametrize("name", ["BayerRG8", "BayerRG10", "BayerRG10p", "BayerRG10Packed", "BayerRG12"])
def test_every_format_of_the_camera_is_read(make_bench: MakeBench, name: str) -> None:
    bench = make_bench()
    camera = bench.camera()
    camera.set_exposure(LABEL)
    assert camera._session is not None
    camera._session.nodes.set("PixelFormat", name)
    camera.arm()
    camera.trigger()
    frame, truth = camera.collect(), shoot(bench.twin)
    lost = 12 - BY_NAME[name].bits
    assert np.array_equal(frame.pixels, truth.pixels >> lost)
    assert frame.white == 4095 >> lost
    assert frame.black[0][0] == truth.black[0][0] / 2**lost


@pytest.mark.parametrize(("left", "top"), [(0, 0), (1, 0), (2, 3), (7, 5)])
def test_a_window_has_the_phase_of_its_first_pixel(make_bench: MakeBench, left: int, top: int) -> None:
    bench = make_bench()
    camera = bench.camera()
    camera.set_exposure(LABEL)
    assert camera._session is not None
    for feature, value in {"Width": 33, "Height": 21, "OffsetX": left, "OffsetY": top}.items():
        camera._session.nodes.set(feature, value)
    camera.arm()
    camera.trigger()
    frame, truth = camera.collect(), shoot(bench.twin).cropped(top, left, 21, 33)
    assert np.array_equal(frame.pixels, truth.pixels)
    assert frame.cfa == truth.cfa


def test_a_bracket_runs_in_the_camera(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera()
    exposures = [Exposure(time=2.0**power, iso=iso) for power, iso in ((-10, 100), (-6, 400), (-3, 100))]
    began = bench.clock.now()
    frames = camera.bracket(exposures)
    for frame, exposure in zip(frames, exposures, strict=True):
        assert frame.metadata.exposure == exposure
        assert np.array_equal(frame.pixels, shoot(bench.twin, exposure).pixels)
    assert bench.clock.now() - began < sum(one.time for one in exposures) + 0.1
    # After it, single frames as before.
    assert np.array_equal(shoot(camera).pixels, shoot(bench.twin).pixels)
    with pytest.raises(CameraRefused, match="8 sets"):
        camera.bracket(exposures * 3)


def test_a_hardware_line_triggers(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera(line="Line1")
    camera.set_exposure(LABEL)
    camera.arm()
    bench.clock.call_later(0.3, lambda: bench.device.line(0))
    bench.clock.call_later(0.5, lambda: bench.device.line(1))
    began = camera.trigger()
    assert np.array_equal(camera.collect().pixels, shoot(bench.twin).pixels)
    assert 0.5 < bench.clock.now() - began < 0.6


def test_no_pulse_is_a_time_out_and_the_next_shot_works(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera(line="Line0")
    camera.set_exposure(LABEL)
    camera.arm()
    camera.trigger()
    with pytest.raises(CameraTimeout, match=r"no pulse on Line0 within 5\.02 s"):
        camera.collect()
    bench.device.line(0)  # Nobody waits any more.
    camera.arm()
    bench.clock.call_later(0.1, lambda: bench.device.line(0))
    camera.trigger()
    assert np.array_equal(camera.collect().pixels, shoot(bench.twin).pixels)


def test_the_exposure_time_comes_with_the_frame(make_bench: MakeBench) -> None:
    bench = make_bench()
    camera = bench.camera()
    camera.set_exposure(LABEL)
    camera.arm()
    camera.trigger()
    # What is set after the trigger concerns the next frame, not this one.
    assert camera._session is not None
    camera._session.nodes.set("ExposureTime", 250_000.0)
    exposure = camera.collect().metadata.exposure
    assert exposure is not None
    assert exposure.time == 2.0**-6


def test_the_throughput_is_limited(make_bench: MakeBench) -> None:
    camera = make_bench().camera()
    assert camera.limit_throughput(50_500_000) == 50_000_000
    assert camera.limit_throughput(10**12) == 400_000_000
    assert camera.limit_throughput(1) == 1_000_000


def test_the_order_of_a_shot_is_kept(make_bench: MakeBench) -> None:
    camera = make_bench().camera()
    with pytest.raises(CameraError, match="call arm before"):
        camera.trigger()
    camera.set_exposure(LABEL)
    camera.arm()
    with pytest.raises(CameraError, match="call trigger before"):
        camera.collect()
    camera.trigger()
    camera.collect()
    with pytest.raises(CameraError, match="call trigger before"):
        camera.collect()


def test_cameras_are_found_by_serial_number(make_bench: MakeBench) -> None:
    bench = make_bench()
    cameras = find_cameras(bench.bus, bench.clock)
    assert [one.serial for one in cameras] == [bench.serial]
    identity = cameras[0].identify()
    assert (identity.serial, identity.kind) == (bench.serial, "raw")
    cameras[0].close()
    with pytest.raises(CameraNotFound, match="SIM-NOBODY"):
        U3vCamera("SIM-NOBODY", bench.bus, bench.clock).identify()


@pytest.mark.parametrize(
    ("formats", "reason"),
    [
        (("RGB8",), "sends neither a Bayer mosaic nor mono (it offers RGB8)"),
        (("RGB8", "YUV8"), "sends neither a Bayer mosaic nor mono (it offers RGB8, YUV8)"),
    ],
)
def test_a_sensor_without_a_mosaic_is_refused(
    make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch, formats: tuple[str, ...], reason: str
) -> None:
    bench, entries = make_bench(), NodeMap.entries
    monkeypatch.setattr(
        NodeMap, "entries", lambda nodes, name: formats if name == "PixelFormat" else entries(nodes, name)
    )
    with pytest.raises(CameraRefused) as refused:
        bench.camera().identify()
    fix = "connect a camera that does in its place."
    assert str(refused.value) == f"camera {bench.serial} {reason}: {fix}"
    assert bench.bus.open_handles == 0


def test_a_camera_that_offers_no_pixel_format_is_not_taken_for_monochrome(
    make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make_bench()
    monkeypatch.setattr(NodeMap, "entries", lambda nodes, name: ())
    with pytest.raises(CameraRefused, match=f"camera {bench.serial} offers no pixel format: close other"):
        bench.camera().identify()
    assert bench.bus.open_handles == 0


def test_opening_and_closing_leaves_nothing_open(make_bench: MakeBench) -> None:
    bench = make_bench()
    for _ in range(30):
        (camera,) = find_cameras(bench.bus, bench.clock)
        camera.identify()
        camera.close()
        camera.close()
    assert bench.bus.open_handles == 0


def test_transfers_add_up_to_the_payload(make_bench: MakeBench) -> None:
    bench = make_bench()
    session = open_session(bench.serial, bench.bus, bench.clock)
    session.stream.start()
    memory = bench.device._memory
    size, count, last, last_2 = (
        memory.stream(one)
        for one in (Sirm.TRANSFER_SIZE, Sirm.TRANSFER_COUNT, Sirm.LAST_TRANSFER, Sirm.LAST_TRANSFER_2)
    )
    payload = int(session.nodes.number("PayloadSize"))
    assert payload == memory.stream(Sirm.REQUIRED_PAYLOAD)
    assert 0 <= count * size + last + last_2 - payload < 1024
    assert size % 1024 == last % 1024 == 0
    assert memory.get(Feature.WIDTH) == session.nodes.number("Width")
    session.close()
