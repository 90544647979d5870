"""The examination of a camera: simulated ones pass, and each that breaks a promise fails where it does."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers import conformance
from drivers.camera import Camera, CameraIdentity
from drivers.conformance import EXAMINATIONS, Examination, bracket, examine
from drivers.discovery import find_cameras
from drivers.errors import CameraRefused
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic


def machine_camera() -> tuple[Camera, BusRig]:
    """A simulated USB3 Vision camera, and its bus."""
    bus = BusRig(simulate("toy", seed=2, cameras=1))
    device = simulate("toy", seed=9, cameras=2).devices[1]
    bus.backend.plug(U3vDevice(device, bus.clock))
    return find_cameras(bus.backend, bus.clock)[1], bus


def of(rows: list[Examination]) -> dict[str, str]:
    return {row.name: row.verdict for row in rows}


@pytest.mark.parametrize("model", ["generic", "canon-eos-6d", "canon-eos-r7", "nikon-z6", "sony-a7m4"])
def test_simulated_bodies_pass(model: str) -> None:
    bus = BusRig(simulate("toy", seed=2, cameras=1), model=model)
    (camera,) = find_cameras(bus.backend, bus.clock)
    rows = list(examine(camera, bus.clock))
    assert of(rows) == dict.fromkeys((ask.__name__ for ask in EXAMINATIONS), "passed"), rows
    assert bus.backend.open_handles == 0


def test_a_machine_vision_camera_passes() -> None:
    camera, bus = machine_camera()
    rows = list(examine(camera, bus.clock))
    assert set(of(rows).values()) == {"passed"}, rows


def test_developed_frames_have_no_noise_and_are_no_raw_ones() -> None:
    bus = BusRig(simulate("toy-ldr", seed=2, cameras=1))  # its body says that it has DNG files
    (camera,) = find_cameras(bus.backend, bus.clock)
    rows = of(list(examine(camera, bus.clock)))
    assert rows.pop("light") == "skipped"
    assert rows.pop("frames") == "failed"
    assert set(rows.values()) == {"passed"}


class Broken:
    """A camera that does one thing otherwise than another one."""

    def __init__(self, camera: Camera, **instead: Callable[..., Any]) -> None:
        self._camera, self._instead = camera, instead

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._camera, name)
        return lambda *given: self._instead[name](method, *given) if name in self._instead else method(*given)


def _other_each_time() -> Callable[..., CameraIdentity]:
    turns = iter(range(1000))
    return lambda method: replace(method(), serial=f"{next(turns)}")


def _too_clean(method: Callable[[], RawMosaic]) -> RawMosaic:
    """It has the less noise the more light there is."""
    frame = method()
    rng = np.random.Generator(np.random.PCG64(int(frame.pixels.sum())))
    more = rng.normal(0, 3000 / (frame.pixels.mean() - np.mean(frame.black)), frame.pixels.shape)
    return replace(frame, pixels=np.clip(frame.pixels + more, 0, frame.white).astype(np.uint16))


def _boasting(method: Callable[[Exposure], Exposure], wanted: Exposure) -> Exposure:
    method(wanted)
    return wanted.with_time(wanted.time * 2)


@pytest.mark.parametrize(
    ("instead", "fails", "says"),
    [
        ({"identify": lambda method: replace(method(), serial="")}, "identity", "no serial number"),
        ({"identify": _other_each_time()}, "identity", ", then as "),
        (
            {"capabilities": lambda method: replace(method(), times=(0.1, 0.01))},
            "capabilities",
            "positive and ascending",
        ),
        ({"set_exposure": _boasting}, "settings", "reads back"),
        (
            {"set_exposure": lambda method, wanted: method(wanted.with_time(wanted.time**0.8)) and wanted},
            "light",
            "a stop of exposure time changes",
        ),
        (
            {"collect": lambda method: replace(method(), pixels=np.zeros((4, 6), np.uint16))},
            "frames",
            "its frame has 6x4",
        ),
        ({"trigger": lambda method: method() - 3600}, "timing", "outside the call"),
        ({"trigger": lambda method: 1 / 0}, "frames", "ZeroDivisionError"),
        ({"collect": _too_clean}, "light", "as photons do"),
    ],
)
def test_a_broken_promise_is_told(instead: dict[str, Any], fails: str, says: str) -> None:
    camera, bus = machine_camera()
    rows = {row.name: row for row in examine(Broken(camera, **instead), bus.clock)}
    assert rows[fails].verdict == "failed", rows
    assert says in rows[fails].says


def test_a_camera_that_does_not_answer_is_let_go() -> None:
    def gone(method: Any) -> Any:
        raise CameraError("The camera is gone: plug it in.")

    camera, bus = machine_camera()
    with pytest.raises(CameraError):
        list(examine(Broken(camera, capabilities=gone), bus.clock))
    assert bus.backend.open_handles == 0


def test_what_a_camera_lacks_is_worded_without_an_order() -> None:
    def none(method: Any, exposures: Any) -> Any:
        raise CameraRefused("1-2 has no such bracket: set and trigger each exposure.")

    camera = BusRig(simulate("toy"), model="sony-a7m4").cameras()[0]
    clock = BusRig(simulate("toy")).clock
    broken = Broken(camera, capabilities=lambda method: replace(method(), width=0, height=0), bracket=none)
    size, bracketed = examine(broken, clock, examinations=[conformance.capabilities, bracket])
    assert size.says.startswith("size known from its first picture, ")
    assert bracketed.says == "none of its own (1-2 has no such bracket): each exposure is set and triggered"
    assert (size.verdict, bracketed.verdict) == ("passed", "passed")


def test_too_dark_a_scene_is_not_a_failure() -> None:
    camera, bus = machine_camera()

    def dark(method: Callable[[], RawMosaic]) -> RawMosaic:
        frame = method()
        return replace(frame, pixels=np.full_like(frame.pixels, int(np.mean(frame.black))))

    (row,) = examine(Broken(camera, collect=dark), bus.clock, examinations=[conformance.light])
    assert row.verdict == "skipped"
    assert "too dark" in row.says


@pytest.mark.parametrize("bad", [False, True])
def test_a_bracket_of_its_own_is_held_to_what_was_asked(*, bad: bool) -> None:
    bus = BusRig(simulate("toy"), model="sony-a7m4")
    camera = bus.cameras()[0]
    if bad:
        method = camera.bracket  # type: ignore[attr-defined]
        camera.bracket = lambda exposures: list(method(exposures))[:2]  # type: ignore[attr-defined]
    (row,) = examine(camera, bus.clock, examinations=[bracket])
    assert row.verdict == ("failed" if bad else "passed"), row
    assert ("the frames of its bracket say" if bad else "3 frames as asked in") in row.says
