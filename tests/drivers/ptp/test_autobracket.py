"""Brackets by the body itself: which are chosen, that every frame is the one asked for, and what if not."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera import CameraFile
from drivers.errors import CameraRefused
from drivers.ptp import PtpCamera
from drivers.ptp.autobracket import AutoBracket, fit, shows
from drivers.ptp.codes import CanonProperty, PropertyCode, ResponseCode
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Fault, Kind
from drivers.sim.ptp import profiles
from drivers.sim.ptp.properties import SimulatedProperties
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.dial_settings import SHUTTER_TIMES
from imaging.exposure import Exposure

LABELS = sorted(SHUTTER_TIMES)
OFFERED = tuple(
    AutoBracket(10 * thirds + frames, thirds, frames) for thirds in range(1, 10) for frames in (3, 5, 7, 9)
)
STOPS = (1 / 500, 1 / 250, 1 / 125, 1 / 60)


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy", cameras=1)


def exposures(*times: float) -> list[Exposure]:
    return [Exposure(time=time, f_number=4.0, iso=100.0) for time in times]


@given(st.integers(0, 54), st.integers(1, 9), st.integers(2, 9))
def test_what_fits_holds_all_exposures_and_no_more_frames_than_needed(
    first: int, thirds: int, count: int
) -> None:
    places = [first + thirds * number for number in range(count)]
    if places[-1] >= len(LABELS):
        return
    found = fit(exposures(*(LABELS[place] for place in places)), OFFERED, LABELS)
    frames = min(frames for frames in (3, 5, 7, 9) if frames >= count)
    if first < thirds * (frames - count):
        assert found is None or found.bracket.frames > frames
        return
    assert found is not None
    assert (found.bracket.thirds, found.bracket.frames) == (thirds, frames)
    middle = LABELS.index(found.middle.time)
    shot = {middle + thirds * step for step in range(-(frames // 2), frames // 2 + 1)}
    assert set(places) <= shot


@pytest.mark.parametrize(
    "wanted",
    [
        exposures(1 / 60),
        exposures(1 / 60, 1 / 60),
        exposures(1 / 60, 1 / 30, 1 / 4),
        exposures(1 / 8000, 1),
        [Exposure(time=1 / 60, iso=100.0), Exposure(time=1 / 30, iso=200.0)],
        exposures(*LABELS[:10]),
    ],
)
def test_what_is_no_even_bracket_fits_none(wanted: list[Exposure]) -> None:
    assert fit(wanted, OFFERED, LABELS) is None


def shot(rig: SimulatedRig, model: str, times: tuple[float, ...], *faults: Fault) -> tuple[float, float]:
    """Seconds of the bracket, and of the same one by one; all frames are what was asked for."""
    bus = BusRig(rig, faults, model=model)
    (camera,) = bus.cameras()
    assert isinstance(camera, PtpCamera)
    wanted = exposures(*times)
    began = bus.clock.now()
    taken = camera.bracket(wanted)
    seconds = bus.clock.now() - began
    for exposure, frame in zip(wanted, taken, strict=True):
        assert isinstance(frame, CameraFile)
        assert frame.metadata.exposure == exposure
    assert len(bus.plan.log) == len(faults)
    began = bus.clock.now()
    for exposure in wanted:
        camera.set_exposure(exposure)
        camera.arm()
        camera.trigger()
        assert camera.collect().metadata.exposure == exposure
    alone = bus.clock.now() - began
    camera.close()
    return seconds, alone


@pytest.mark.parametrize(
    ("model", "times"),
    [
        ("sony-a7m4", (1 / 250, 1 / 60, 1 / 15, 1 / 4)),
        ("sony-a7m4", (*STOPS, 1 / 30)),
        ("canon-eos-6d", STOPS[1:]),
    ],
)
def test_a_bracket_of_the_body_is_faster_than_one_by_one(
    toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch, model: str, times: tuple[float, ...]
) -> None:
    """At the speed of simulated bodies, and much so where an order takes 0.3 s, as it does on many."""
    seconds, alone = shot(toy, model, times)
    assert seconds < 0.9 * alone
    slow = replace(profiles.PROFILES[model], lag=0.3)
    monkeypatch.setitem(profiles.PROFILES, model, slow)
    seconds, alone = shot(toy, model, times)
    assert seconds < 0.6 * alone


@pytest.mark.parametrize("model", sorted(profiles.PROFILES))
@pytest.mark.parametrize("times", [STOPS, (1 / 60, 1 / 4, 1 / 2), (1 / 125,)])
def test_every_make_brings_every_bracket(toy: SimulatedRig, model: str, times: tuple[float, ...]) -> None:
    shot(toy, model, times)


PRESS = {"sony-a7m4": ("SET_CONTROL_B", 2), "canon-eos-6d": ("REMOTE_RELEASE_ON", 2)}
FETCH = {"sony-a7m4": "GET_OBJECT", "canon-eos-6d": "GET_PARTIAL_OBJECT"}


@pytest.mark.parametrize("model", sorted(PRESS))
def test_frames_that_are_not_as_asked_are_shot_one_by_one(toy: SimulatedRig, model: str) -> None:
    """The body exposes twice as long as it should, and its files say so."""
    operation, nth = PRESS[model]
    off = Fault(Kind.EXPOSURE_OFF, operation=operation, nth=nth, share=1.0)
    seconds, alone = shot(toy, model, STOPS[1:], off)
    assert seconds > alone


@pytest.mark.parametrize("model", sorted(FETCH))
@pytest.mark.parametrize("kind", [Kind.UNPLUG, Kind.STALL])
def test_a_bracket_that_breaks_off_is_completed(toy: SimulatedRig, model: str, kind: Kind) -> None:
    fault = Fault(kind, operation=FETCH[model], nth=2, seconds=0.2, count=100)
    shot(toy, model, STOPS[1:], fault)


def test_a_body_that_keeps_its_drive_mode_shoots_one_by_one(
    toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    as_told = SimulatedProperties.set

    def stubborn(self: SimulatedProperties, code: int, data: bytes) -> ResponseCode:
        return ResponseCode.OK if code == PropertyCode.STILL_CAPTURE_MODE else as_told(self, code, data)

    monkeypatch.setattr(SimulatedProperties, "set", stubborn)
    seconds, alone = shot(toy, "sony-a7m4", STOPS)
    assert seconds > alone


@pytest.mark.parametrize("model", sorted(PRESS))
def test_a_body_that_a_bracket_left_in_its_mode_is_set_back(toy: SimulatedRig, model: str) -> None:
    bus = BusRig(toy, model=model)
    (camera,) = bus.cameras()
    assert isinstance(camera, PtpCamera)
    body = camera._connected()
    body.set_auto_bracket(body.auto_brackets()[0])
    camera._drop()
    camera.set_exposure(exposures(1 / 60)[0])
    camera.arm()
    camera.trigger()
    assert camera.collect().metadata.exposure == exposures(1 / 60)[0]
    body = camera._connected()
    if model == "canon-eos-6d":
        assert body.describe(CanonProperty.AEB).current == 0
    else:
        assert body.describe(PropertyCode.STILL_CAPTURE_MODE).current == 1
    camera.close()


def test_a_file_that_is_silent_proves_nothing() -> None:
    wanted = Exposure(time=1 / 60, f_number=4.0, iso=100.0)
    assert not shows(None, wanted)
    assert shows(Exposure(time=1 / 64), wanted)
    assert not shows(Exposure(time=1 / 64, iso=200.0), wanted)


@pytest.mark.parametrize("act", ["set_auto_bracket", "shoot_bracket"])
def test_a_body_without_brackets_refuses_them_in_a_sentence(toy: SimulatedRig, act: str) -> None:
    bus = BusRig(toy, model="generic")
    (camera,) = bus.cameras()
    assert isinstance(camera, PtpCamera)
    body = camera._connected()
    assert body.auto_brackets() == ()
    given = (None,) if act == "set_auto_bracket" else (None, 1.0)
    with pytest.raises(CameraRefused, match=r"shoots no brackets .*: set and trigger each exposure\.$"):
        getattr(body, act)(*given)
    camera.close()
