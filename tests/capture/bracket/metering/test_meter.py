"""The meter and the plan that follows from it, on simulated cameras that look at light that is known."""

from dataclasses import replace

import numpy as np
import pytest

from capture.bracket.exposure_choices import exposure_list
from capture.bracket.goals import BracketGoals
from capture.bracket.metering.meter import meter
from capture.bracket.planner import SLACK, plan_bracket
from capture.bracket.raw_noise import profile_of
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.rigs import simulate
from imaging.errors import CaptureError
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import mosaic

WIDTH, HEIGHT = 64, 48


class Scene:
    """A camera of the toy rig before a wall of the radiance `wall` [H, W], grey, or broadcast to it."""

    def __init__(self, wall, index: int = 0) -> None:
        self.body = simulate("toy", 4).bodies[index]
        grey = np.broadcast_to(np.asarray(wall, np.float64), (HEIGHT, WIDTH))
        view = np.repeat(grey[..., None], 3, axis=2)
        self.camera = SimulatedCamera(self.body, lambda frame: view)
        self.channels = self.body.cfa.channels(HEIGHT, WIDTH)
        self.truth = mosaic(self.body.optics.exposure(view), self.body.cfa)
        """Signal per second of exposure scale of every photosite, without noise."""

    def list(self, wanted: BracketGoals) -> tuple[Exposure, ...]:
        able = self.camera.capabilities()
        return exposure_list(able.times, able.isos, 4.0, wanted)

    def meter(self, wanted: BracketGoals):
        return meter({"cam0": self.camera}, [e for e in self.list(wanted) if e.iso == 100])

    def shots(self, exposure: Exposure, count: int) -> np.ndarray:
        """[count, H, W], signal; NaN where clipped."""
        frames = []
        for _ in range(count):
            self.camera.set_exposure(exposure)
            self.camera.arm()
            self.camera.trigger()
            frame = self.camera.collect()
            frames.append(np.where(frame.saturated(), np.nan, frame.signal()))
        return np.stack(frames).astype(np.float64)


def ramp(stops: float, middle: float = 8.0) -> np.ndarray:
    """[1, W], evenly spaced in stops."""
    return middle * 2.0 ** np.linspace(-stops / 2, stops / 2, WIDTH)[None, :]


@pytest.mark.parametrize(("stops", "middle"), [(0, 0.2), (0, 300.0), (8, 8.0), (14, 8.0), (17, 30.0)])
def test_the_metered_range_is_that_of_the_scene(stops, middle):
    """Within the slack and what shutters differ from their labels, 0.1 stops."""
    scene = Scene(ramp(stops, middle))
    metering = scene.meter(BracketGoals())
    assert len(metering.targets) == 3
    for channel, target in enumerate(metering.targets):
        truth = scene.truth[scene.channels == channel]
        assert target.no_darker
        assert target.no_brighter
        assert abs(np.log2(target.dark / np.percentile(truth, 0.1))) < SLACK + 0.1
        assert abs(np.log2(target.bright / np.percentile(truth, 99.99))) < SLACK + 0.1
    steps = np.diff([probe.stops for probe in metering.probes])
    assert all(steps > 2)


def reached(scene: Scene, exposures, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Measured and predicted SNR of the best exposure of each photosite, dB, pooled over like ones.

    Bins of a quarter stop of true radiance; the variance is that from shot to shot.
    """
    noise = scene.meter(BracketGoals()).targets[0].noise
    groups = np.rint(4 * np.log2(scene.truth)).astype(int)
    best = {int(g): (-np.inf, -np.inf) for g in np.unique(groups)}
    for exposure in exposures:
        shots = scene.shots(exposure, count)
        for group in best:
            inside = shots[:, groups == group]
            if np.isfinite(inside).all():
                snr = 10 * np.log10((inside.mean(axis=0) ** 2).mean() / inside.var(axis=0, ddof=1).mean())
                light = float(np.sqrt((scene.truth[groups == group] ** 2).mean()))
                best[group] = max(best[group], (snr, noise.snr(light, exposure)))
    values = np.array(list(best.values()))
    return values[:, 0], values[:, 1]


@pytest.mark.parametrize("snr", [14.0, 20.0, 26.0])
def test_every_radiance_reaches_the_wanted_snr_in_frames(snr):
    """60 shots of 13 stops. Shutters that differ from their label by 0.09 stops change the SNR by 0.55 dB."""
    scene = Scene(ramp(13))
    wanted = BracketGoals(snr=snr)
    plan = plan_bracket(scene.meter(wanted).targets, scene.list(wanted), wanted)
    assert plan.shortfalls == ()
    measured, predicted = reached(scene, plan.exposures, 60)
    assert measured.min() > snr - 0.3
    assert np.abs(measured - predicted).mean() < 0.25
    assert np.abs(measured - predicted).max() < 0.8
    # One exposure fewer, whichever it is, does not do.
    for left_out in plan.exposures:
        fewer = [exposure for exposure in plan.exposures if exposure != left_out]
        assert not fewer or reached(scene, fewer, 12)[0].min() < snr - 1


@pytest.mark.parametrize(("low", "high", "count"), [(8, 8, 1), (2, 40, 1), (0.1, 40, 2), (0.02, 1500, 3)])
def test_walls_of_two_levels_take_as_many_exposures_as_their_range_asks_for(low, high, count):
    """0, 4.3, 8.6 and 16.2 stops, and about 1.2 of colour and vignetting, where an exposure shows 6.3."""
    wall = np.full((HEIGHT, WIDTH), float(low))
    wall[:, WIDTH // 2 :] = high
    scene = Scene(wall)
    plan = plan_bracket(scene.meter(BracketGoals()).targets, scene.list(BracketGoals()), BracketGoals())
    # Two levels can leave a gap between them that needs no exposure, but the list is covered as a range.
    assert (len(plan.exposures), plan.shortfalls) == (count, ())


def test_a_black_scene_is_said_to_be_black():
    with pytest.raises(CaptureError, match=r"the scene is black: no camera sees light at 1/30 s"):
        Scene(0.0).meter(BracketGoals(slowest=1 / 30))


def test_a_scene_too_bright_for_the_fastest_shutter_is_said_to_be():
    with pytest.raises(CaptureError, match=r"too bright: every camera clips all over at 1/8000 s"):
        Scene(1e7).meter(BracketGoals())


def test_a_lamp_that_clips_in_the_shortest_exposure_is_not_called_covered():
    wall = np.full((HEIGHT, WIDTH), 8.0)
    wall[:6, :6] = 1e7
    scene = Scene(wall)
    plan = plan_bracket(scene.meter(BracketGoals()).targets, scene.list(BracketGoals()), BracketGoals())
    assert {shortfall.part for shortfall in plan.shortfalls} == {"bright"}
    assert all(shortfall.at_least for shortfall in plan.shortfalls)


def test_shadows_that_a_slow_limit_hides_are_not_called_covered():
    wanted = BracketGoals(slowest=1 / 30)
    wall = np.full((HEIGHT, WIDTH), 8.0)
    wall[:, :20] = 1e-4
    scene = Scene(wall)
    metering = scene.meter(wanted)
    assert max(probe.time for probe in metering.probes) <= 1 / 30
    assert not any(target.no_darker for target in metering.targets)
    plan = plan_bracket(metering.targets, scene.list(wanted), wanted)
    dark = [shortfall for shortfall in plan.shortfalls if shortfall.part == "dark"]
    assert len(dark) == 3
    assert "at least" in str(dark[0])


def test_a_camera_that_fails_is_named_and_the_others_are_metered():
    scene = Scene(8.0)
    broken = Scene(8.0, index=1).camera
    broken.close()
    exposures = [e for e in scene.list(BracketGoals()) if e.iso == 100]
    metering = meter({"cam0": scene.camera, "cam1": broken}, exposures)
    assert {target.camera for target in metering.targets} == {"cam0"}
    assert list(metering.failed) == ["cam1"]
    with pytest.raises(CaptureError, match="no camera gave a picture"):
        meter({"cam1": broken}, exposures)


def test_a_camera_with_its_cap_on_does_not_slow_the_others_down():
    scene, capped = Scene(8.0), Scene(0.0, index=1)
    exposures = [e for e in scene.list(BracketGoals()) if e.iso == 100]
    metering = meter({"cam0": scene.camera, "cam1": capped.camera}, exposures)
    assert {target.camera for target in metering.targets} == {"cam0"}
    assert metering.failed == {"cam1": "it sees no light at 30 s f/4 ISO 100"}


def test_a_large_frame_is_metered_by_evenly_spread_blocks(monkeypatch):
    monkeypatch.setattr("capture.bracket.metering.percentile.ENOUGH", WIDTH * HEIGHT // 4)
    wall = np.full((HEIGHT, WIDTH), 1.0)
    wall[20:32, 20:32] = 500.0
    scene = Scene(wall)
    for channel, target in enumerate(scene.meter(BracketGoals()).targets):
        truth = scene.truth[scene.channels == channel]
        assert abs(np.log2(target.dark / np.percentile(truth, 0.1))) < SLACK + 0.1
        assert abs(np.log2(target.bright / np.percentile(truth, 99.99))) < SLACK + 0.1


def planned(wall, wanted: BracketGoals):
    scene = Scene(wall)
    return plan_bracket(scene.meter(wanted).targets, scene.list(wanted), wanted)


def test_one_bright_photosite_is_taken_for_a_hot_one_and_sixteen_for_a_lamp():
    wall = np.full((HEIGHT, WIDTH), 8.0)
    wall[20, 20] = 8.0 * 2**12
    assert len(planned(wall, BracketGoals()).exposures) == 1
    wall[20:24, 20:24] = 8.0 * 2**12
    assert len(planned(wall, BracketGoals()).exposures) == 3


@pytest.mark.parametrize("middle", [8.0, 300.0, 1e4])
@pytest.mark.parametrize("stops", [20, 30])
def test_what_no_list_covers_is_finite_and_said(stops, middle):
    """Shutters from 1/8000 s to 30 s and an exposure of 6 stops show 24; here all or part lies beyond."""
    scene = Scene(ramp(stops, middle))
    metering = scene.meter(BracketGoals())
    for target in metering.targets:
        assert 0 < target.dark <= target.bright < np.inf
    plan = plan_bracket(metering.targets, scene.list(BracketGoals()), BracketGoals())
    assert plan.shortfalls
    assert 3 <= len(plan.exposures) <= 5
    assert all(np.isfinite(shortfall.stops) for shortfall in plan.shortfalls)


def test_half_a_scene_without_any_light_is_not_called_covered():
    wall = np.full((HEIGHT, WIDTH), 8.0)
    wall[:, : WIDTH // 2] = 0.0
    plan = planned(wall, BracketGoals())
    assert {(one.part, one.at_least) for one in plan.shortfalls} == {("dark", True)}


def test_limits_that_leave_nothing_are_said():
    with pytest.raises(CaptureError, match="60 dB are out of the reach of cam0, which gives 38"):
        planned(ramp(4), BracketGoals(snr=60.0))
    with pytest.raises(
        CaptureError, match=r"black: no camera sees light at 1/8000 s .* allow longer exposures"
    ):
        planned(ramp(4), BracketGoals(slowest=1 / 8000, total=1.0))
    with pytest.raises(CaptureError, match=r"no bracket fits into 0\.0001 s in all"):
        planned(ramp(4), BracketGoals(total=1e-4))


class Silent:
    """A camera whose frames do not state their noise, as those of machine vision cameras."""

    def __init__(self, camera: SimulatedCamera) -> None:
        self._camera = camera

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def collect(self):
        return replace(self._camera.collect(), noise_profile=None)


@pytest.mark.parametrize(("stops", "middle"), [(8, 8.0), (14, 8.0), (0, 300.0), (0, 0.002)])
def test_noise_that_no_file_states_is_estimated_from_two_takes(stops, middle):
    scene = Scene(ramp(stops, middle))
    stated = scene.meter(BracketGoals())
    scene.camera = Silent(scene.camera)
    estimated = scene.meter(BracketGoals())
    exposure = Exposure(time=1 / 60, f_number=4.0, iso=100)
    for one, other in zip(stated.targets, estimated.targets, strict=True):
        assert np.log2(other.dark / one.dark) == pytest.approx(0, abs=0.3)
        assert np.log2(other.bright / one.bright) == pytest.approx(0, abs=0.3)
        floors = [target.noise.profile(exposure)[1] for target in (one, other)]
        # Light that is bright everywhere hides the noise of reading: the longer line to zero errs by more.
        assert floors[1] == pytest.approx(floors[0], rel=2.0 if (stops, middle) == (0, 300.0) else 0.3)
        signal = 0.5 / exposure.scale
        if middle * 2 ** (stops / 2) > 1:  # light that shows its own noise
            assert other.noise.snr(signal, exposure) == pytest.approx(
                one.noise.snr(signal, exposure), abs=1.5
            )


def test_frames_without_light_state_the_noise_of_reading_alone():
    scene = Scene(0.0)
    scene.camera.set_exposure(Exposure(time=1 / 60, f_number=4.0, iso=100))
    frames = []
    for _ in range(2):
        scene.camera.arm()
        scene.camera.trigger()
        frames.append(replace(scene.camera.collect(), noise_profile=None))
    slope, floor = profile_of([(frames[0], frames[1])])
    stated = Scene(8.0).meter(BracketGoals()).targets[0].noise
    true = stated.profile(Exposure(time=1 / 60, f_number=4.0, iso=100))
    assert 0 < slope < 1
    assert floor == pytest.approx(true[1], rel=0.2)
    white = replace(frames[0], pixels=np.full_like(frames[0].pixels, 65535))
    assert profile_of([(white, white)])[0] > 0
