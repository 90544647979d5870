"""Brackets by the body itself: which are chosen, that every frame is the one asked for, and what if not."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import CameraRefused
from drivers.ptp import PtpCamera
from drivers.ptp.autobracket import AutoBracket, best_fit, fit, shows
from drivers.ptp.protocol.codes import CanonProperty, NikonProperty, PropertyCode
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Fault
from drivers.sim.ptp import profiles
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.optics.dial_settings import SHUTTER_TIMES
from imaging.optics.exposure import Exposure
from tests.drivers.shots import shot

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
    fitted = fit(exposures(*(LABELS[place] for place in places)), OFFERED, LABELS)
    frames = min(frames for frames in (3, 5, 7, 9) if frames >= count)
    if first < thirds * (frames - count):
        assert fitted is None or fitted.bracket.frames > frames
        return
    assert fitted is not None
    assert (fitted.bracket.thirds, fitted.bracket.frames) == (thirds, frames)
    middle = LABELS.index(fitted.middle.time)
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


def opened(rig: SimulatedRig, model: str, *faults: Fault) -> tuple[BusRig, PtpCamera]:
    bus = BusRig(rig, faults, model=model)
    (camera,) = bus.cameras()
    assert isinstance(camera, PtpCamera)
    return bus, camera


def compared(rig: SimulatedRig, model: str, times: tuple[float, ...]) -> tuple[float, float]:
    """Seconds of the third bracket in a row, and of the same one by one; all is as asked for."""
    bus, camera = opened(rig, model)
    wanted = exposures(*times)
    for _ in range(3):
        began = bus.clock.now()
        exposures_shot = [frame.metadata.exposure for frame in camera.bracket(wanted)]
        seconds = bus.clock.now() - began
        assert all(exposures_shot.count(exposure) == 1 for exposure in wanted)
    assert shot(camera, wanted[-1]).metadata.exposure == wanted[-1]
    began = bus.clock.now()
    for exposure in wanted:
        assert shot(camera, exposure).metadata.exposure == exposure
    alone = bus.clock.now() - began
    camera.close()
    return seconds, alone


@pytest.mark.parametrize(
    ("model", "times", "at_once", "share"),
    [
        ("sony-a7m4", (1 / 250, 1 / 60, 1 / 15, 1 / 4), 0.9, 0.58),
        ("sony-a7m4", (*STOPS, 1 / 30), 0.9, 0.58),
        ("canon-eos-6d", STOPS[1:], 1.4, 0.72),
    ],
)
def test_a_bracket_of_the_body_is_faster_than_one_by_one(
    toy: SimulatedRig,
    monkeypatch: pytest.MonkeyPatch,
    model: str,
    times: tuple[float, ...],
    at_once: float,
    share: float,
) -> None:
    """Compare bodies of which an order takes 0.3 s, as on many, and none."""
    seconds, alone = compared(toy, model, times)
    assert seconds < at_once * alone
    slow = replace(profiles.PROFILES[model], lag=0.3)
    monkeypatch.setitem(profiles.PROFILES, model, slow)
    seconds, alone = compared(toy, model, times)
    assert seconds < share * alone


def test_four_frames_take_less_than_half_the_time_of_one_by_one(
    toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Use a body that shoots 10 frames a second, and takes 0.3 s from an order to the exposure.

    Nikon's shoots 5.5, and five of them for four.
    """
    monkeypatch.setitem(profiles.PROFILES, "sony-a7m4", replace(profiles.PROFILES["sony-a7m4"], lag=0.3))
    seconds, alone = compared(toy, "sony-a7m4", STOPS)
    assert seconds < 0.5 * alone
    monkeypatch.setitem(profiles.PROFILES, "nikon-z6", replace(profiles.PROFILES["nikon-z6"], lag=0.3))
    seconds, alone = compared(toy, "nikon-z6", STOPS)
    assert seconds < 0.65 * alone


@pytest.mark.parametrize("model", sorted(profiles.PROFILES))
@pytest.mark.parametrize("times", [(1 / 60, 1 / 4, 1 / 2), (1 / 125,), STOPS[:2]])
def test_what_no_bracket_holds_is_refused_before_anything_is_exposed(
    toy: SimulatedRig, model: str, times: tuple[float, ...]
) -> None:
    _, camera = opened(toy, model)
    with pytest.raises(CameraRefused, match=r"has no such bracket: set and trigger each exposure\.$"):
        next(camera.bracket(exposures(*times)))
    assert shot(camera, exposures(1 / 60)[0]).metadata.exposure == exposures(1 / 60)[0]
    camera.close()


def test_the_most_neighbours_that_a_body_has_a_bracket_of_are_shot_together() -> None:
    three = tuple(one for one in OFFERED if one.frames == 3)
    fitted = best_fit(exposures(*STOPS), three, LABELS)
    assert fitted is not None
    assert (fitted.bracket.thirds, fitted.middle) == (3, exposures(1 / 250)[0])
    fitted = best_fit(exposures(1 / 4000, *STOPS), OFFERED, LABELS)
    assert fitted is not None
    assert fitted.bracket.frames == 5
    assert best_fit(exposures(*STOPS[:2]), OFFERED, LABELS) is None


@pytest.mark.parametrize("model", ["canon-eos-6d", "nikon-z6", "sony-a7m4"])
def test_a_body_that_writes_raw_and_jpeg_shoots_them_one_by_one(
    toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch, model: str
) -> None:
    monkeypatch.setitem(profiles.PROFILES, model, replace(profiles.PROFILES[model], jpeg=True))
    _, camera = opened(toy, model)
    with pytest.raises(CameraRefused, match="has no such bracket"):
        next(camera.bracket(exposures(*STOPS)))
    camera.close()


MAKES = ("canon-eos-6d", "nikon-z6", "sony-a7m4")


@pytest.mark.parametrize("model", MAKES)
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
    elif model == "nikon-z6":
        assert body.describe(NikonProperty.BRACKET_ENABLE).current == 0
        assert body.describe(PropertyCode.STILL_CAPTURE_MODE).current == 1
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
    with pytest.raises(CameraRefused, match=r"has no brackets .*: set and trigger each exposure\.$"):
        getattr(body, act)(*given)
    camera.close()
