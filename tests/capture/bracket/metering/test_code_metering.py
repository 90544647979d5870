"""Cameras that develop their photographs: the tone curve seen in probes, and brackets planned from it."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from capture.bracket.code_noise import BRIGHTEST, DARKEST, CodeNoise
from capture.bracket.exposure_choices import exposure_list
from capture.bracket.goals import BracketGoals
from capture.bracket.metering.meter import meter
from capture.bracket.planner import plan_bracket
from drivers.sim.camera import response
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.rigs import simulate
from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.errors import CaptureError
from imaging.files.photo import decode_photo
from imaging.optics.exposure import Exposure

WIDTH, HEIGHT = 64, 48


def probed(develop, stops: float = 2.0) -> CodeNoise:
    """The curve from noisy codes of 4,000 things of all brightnesses, nine probes."""
    rng = np.random.default_rng(3)
    light = 2.0 ** rng.uniform(-12, 4, 4000)
    codes = [
        np.clip(np.rint(255 * develop(light * 2.0 ** (stops * n)) + rng.normal(0, 0.7, 4000)), 0, 255) / 255
        for n in range(-4, 5)
    ]
    pairs = list(pairwise(codes))
    lower, upper = (np.concatenate([pair[side] for pair in pairs]) for side in (0, 1))
    return CodeNoise.of(lower, upper, np.full(len(lower), stops))


@pytest.mark.parametrize(
    ("develop", "exposure_of"),
    [
        (response.develop, response.exposure_of),
        (lambda x: srgb_encode(np.clip(x, 0, 1)), srgb_decode),
        (lambda x: np.clip(x, 0, 1) ** (1 / 1.6), lambda c: c**1.6),
    ],
)
def test_the_curve_is_that_of_the_camera_within_a_sixth_of_a_stop(develop, exposure_of):
    noise = probed(develop)
    truth = np.log(exposure_of(noise.codes) / exposure_of(np.array(BRIGHTEST)))
    assert np.abs(noise.light - truth).max() < math.log(2) / 6
    assert (noise.codes[0], noise.codes[-1]) == (DARKEST, BRIGHTEST)


def test_without_pairs_the_curve_is_that_of_srgb():
    noise = CodeNoise.of(*np.zeros((3, 0)))
    truth = np.log(srgb_decode(noise.codes) / srgb_decode(BRIGHTEST))
    assert np.abs(noise.light - truth).max() < 0.02


def test_the_snr_is_that_of_a_code_of_noise():
    """Below code 10.3 of sRGB, light is proportional to the code: the SNR is the code over its noise."""
    noise = CodeNoise.of(*np.zeros((3, 0)))
    exposure = Exposure(time=1.0)
    darkest = noise.darkest(10.0, exposure)
    assert darkest == pytest.approx(math.exp(noise.light[0]))
    assert noise.snr(darkest, exposure) == pytest.approx(20.0, abs=1.0)
    assert noise.snr(darkest / 10, exposure) == pytest.approx(noise.snr(darkest, exposure) - 20)
    assert noise.snr(0.0, exposure) == -math.inf
    # 30 dB need a code well above the darkest; 60 dB none has.
    assert noise.darkest(30.0, exposure) > 4 * darkest
    assert noise.darkest(60.0, exposure) == math.inf


class Scene:
    """A camera of the toy-ldr rig before a grey wall of the radiance `wall`, [H, W] or broadcast to it."""

    def __init__(self, wall, slowest: float | None = None) -> None:
        body = simulate("toy-ldr", 4).bodies[0]
        # One hot photosite of so few is more than 0.01 %, and JPEG spreads it over its neighbours.
        body = replace(body, sensor=replace(body.sensor, hot_share=0.0))
        grey = np.broadcast_to(np.asarray(wall, np.float64), (HEIGHT, WIDTH))
        view = np.repeat(grey[..., None], 3, axis=2)
        self.camera = SimulatedCamera(body, lambda frame: view)
        able = self.camera.capabilities()
        self.list = exposure_list(able.times, (100.0,), 4.0, BracketGoals(slowest=slowest))

    def meter(self):
        return meter({"cam0": self.camera}, self.list)

    def codes(self, exposure: Exposure) -> np.ndarray:
        self.camera.set_exposure(exposure)
        self.camera.arm()
        self.camera.trigger()
        return decode_photo(self.camera.collect().data, "a frame").pixels


def ramp(stops: float, middle: float = 8.0) -> np.ndarray:
    return middle * 2.0 ** np.linspace(-stops / 2, stops / 2, WIDTH)[None, :]


@pytest.mark.parametrize(("stops", "count"), [(0, 1), (3, 1), (9, 2), (13, 3)])
def test_every_pixel_has_a_trusted_code_in_a_planned_photograph_and_none_can_be_left_out(stops, count):
    """The curve of these cameras shows 6.1 stops from code 10 to 245; a wall has 1.1 more of vignetting."""
    scene = Scene(ramp(stops))
    plan = plan_bracket(scene.meter().targets, scene.list, BracketGoals(snr=10.0))
    assert (len(plan.exposures), plan.shortfalls) == (count, ())
    trusted = [
        (codes >= DARKEST - 4 / 255) & (codes <= BRIGHTEST + 4 / 255)  # JPEG at 95 errs by some codes
        for codes in (scene.codes(exposure) for exposure in plan.exposures)
    ]
    assert np.any(trusted, axis=0).mean() > 0.998
    for left_out in range(count):
        others = [mask for number, mask in enumerate(trusted) if number != left_out]
        assert not others or np.any(others, axis=0).mean() < 0.99


@pytest.mark.parametrize("stops", [6, 12, 16])
def test_the_metered_range_is_that_of_the_scene(stops):
    """Up to vignetting, which darkens the corners, and to labels of shutters."""
    targets = Scene(ramp(stops)).meter().targets
    assert len(targets) == 3
    assert all(target.no_darker and target.no_brighter for target in targets)
    for target in targets:
        assert stops - 0.3 < target.stops < stops + 1.4


def test_a_large_photograph_is_metered_by_evenly_spread_blocks(monkeypatch):
    """Blocks of four columns: the ramp's last four may be left out, at either end."""
    whole, four_columns = Scene(ramp(9)).meter().targets, 4 * 9 / (WIDTH - 1)
    monkeypatch.setattr("capture.bracket.metering.percentile.ENOUGH", WIDTH * HEIGHT * 3 // 4)
    for target, full_target in zip(Scene(ramp(9)).meter().targets, whole, strict=True):
        assert abs(math.log2(target.dark / full_target.dark)) < four_columns + 0.1
        assert abs(math.log2(target.bright / full_target.bright)) < four_columns + 0.1


def test_black_and_glare_are_said():
    with pytest.raises(CaptureError, match="the scene is black: no camera sees light at 1/30 s"):
        Scene(0.0, slowest=1 / 30).meter()
    with pytest.raises(CaptureError, match="too bright: every camera clips all over"):
        Scene(1e7).meter()


def test_shadows_that_no_exposure_shows_are_not_called_covered():
    wall = np.full((HEIGHT, WIDTH), 8.0)
    wall[:, :20] = 1e-5
    scene = Scene(wall)
    targets = scene.meter().targets
    assert not any(target.no_darker for target in targets)
    plan = plan_bracket(targets, scene.list, BracketGoals())
    assert {shortfall.part for shortfall in plan.shortfalls} == {"dark"}


def test_an_snr_that_no_code_has_is_refused():
    scene = Scene(ramp(4))
    with pytest.raises(CaptureError, match=r"60 dB are out of the reach of cam0, which gives \d\d\.\d dB"):
        plan_bracket(scene.meter().targets, scene.list, BracketGoals(snr=60.0))


def test_raw_and_developing_cameras_share_a_bracket():
    raw = simulate("toy", 4).bodies[0]
    view = np.repeat(np.broadcast_to(ramp(9), (HEIGHT, WIDTH))[..., None], 3, axis=2)
    scene = Scene(ramp(9))
    cameras = {"cam0": SimulatedCamera(raw, lambda frame: view), "cam1": scene.camera}
    metering = meter(cameras, scene.list)
    assert {target.camera for target in metering.targets} == {"cam0", "cam1"}
    plan = plan_bracket(metering.targets, scene.list, BracketGoals())
    assert plan.shortfalls == ()
    assert len(plan.exposures) == 2
