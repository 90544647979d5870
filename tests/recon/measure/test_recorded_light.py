"""Light of held-out photographs against renders of known light, by hand: clipped, noisy, and in between."""

import numpy as np
import pytest
import torch

from imaging.merge.linear_frame import SensorSignalNoise
from imaging.sensor.cfa import Cfa
from imaging.session.calibration import Response
from recon.data.dataset import Sensor, View
from recon.data.shot import HeldPlanes, Shot
from recon.measure.recorded_light import MOST_SAMPLES, against_photographs, recorded_light
from recon.observe.linear import LinearLight
from recon.observe.photographs import Display
from recon.splat import SplatCamera

LINEAR = Response(kind="linear", evidence="test")


def view_of(light, scales, kind="raw", noise=None, **sensor):
    """A view of light [H, W, 3] that is grey, in shots of such scales that end at 1."""
    height, width = light.shape[:2]
    shots = []
    for k in scales:
        signal = np.minimum((light[..., 0] if kind == "raw" else light) * k, 1).astype(np.float32)
        none = np.zeros(signal.shape, bool)
        ceiling = 1.0 if kind == "raw" else None
        shots.append(Shot("", k, HeldPlanes(signal, signal >= 1, none, ~none), noise, ceiling))
    lens = SplatCamera(np.eye(4), 50.0, 50.0, width / 2, height / 2, width, height)
    cfa = Cfa.RGGB if kind == "raw" else None
    built = {"falloff": np.ones((height, width), np.float32)} | sensor
    return View("c", 0, lens, Sensor(kind, cfa, np.eye(3), response=LINEAR, **built), tuple(shots))


def ramp(stops=10, height=64, width=160):
    """Grey light from 2^0 at the left to 2^stops at the right."""
    light = 2.0 ** np.linspace(0, stops, width)
    return np.broadcast_to(light[None, :, None], (height, width, 3)).astype(np.float32)


def figures(view, light, normaliser=1.0, observation=None):
    image = torch.from_numpy(np.ascontiguousarray(light) / normaliser)
    return against_photographs([recorded_light(observation or LinearLight(normaliser), image, view)])


def test_the_light_itself_is_right_in_every_band():
    light = ramp()
    by_band = figures(view_of(light, (2.0**-4, 2.0**-11)), light)
    assert by_band.pop("stops_against") == "photographs"
    assert by_band == pytest.approx(dict.fromkeys(by_band, 0.0), abs=1e-5)
    assert set(by_band) == {
        f"stops_{name}" for name in ("median", "dark", "middle", "bright", "brightest", "bound")
    }


def test_a_halo_that_is_too_dark_is_seen_however_bright_it_is():
    """Two stops too dark in the upper tenth of the light, half a stop too bright in the lowest."""
    light = ramp()
    render = light.copy()
    render[:, 144:] /= 4
    render[:, :16] *= np.sqrt(2)
    by_band = figures(view_of(light, (2.0**-4, 2.0**-11)), render, normaliser=7.0)
    expected = {"stops_dark": 0.5, "stops_middle": 0.0, "stops_bright": 2.0, "stops_brightest": 2.0}
    assert {name: by_band[name] for name in expected} == pytest.approx(expected, abs=1e-4)


def test_where_every_shot_clips_more_light_is_right_and_less_is_not():
    """The shortest shot ends at 2^8, which the last fifth of the ramp exceeds."""
    light = ramp()
    view = view_of(light, (2.0**-4, 2.0**-8))
    bright = figures(view, 16 * light)
    assert bright["stops_bright"] == bright["stops_brightest"] == 0.0
    assert bright["stops_middle"] == pytest.approx(4.0, abs=1e-4)
    assert bright["stops_bound"] == 1.0
    assert figures(view, np.minimum(light, 2.0**6))["stops_brightest"] == pytest.approx(2.0, abs=1e-4)


def test_light_below_the_noise_is_bounded_from_above():
    """Three standard deviations are 0.3: light below is anything up to it, and nothing more."""
    light = np.full((16, 16, 3), 0.1, np.float32)
    view = view_of(light, (1.0,), noise=SensorSignalNoise(0.0, 0.01))
    assert figures(view, light / 8)["stops_dark"] == 0.0
    assert figures(view, 12 * light)["stops_dark"] == pytest.approx(2.0, abs=1e-4)


def test_masked_pixels_have_no_part():
    light = ramp()
    view = view_of(light, (2.0**-11,))
    shot = view.shots[0]
    valid = np.ones(shot.pixels.shape, bool)
    valid[:, :80] = False
    masked = View("c", 0, view.lens, view.sensor, (shot.showing(valid=valid),))
    render = light.copy()
    render[:, :80] *= 100
    assert figures(masked, render)["stops_dark"] == pytest.approx(0.0, abs=1e-5)


def test_photographs_are_compared_behind_their_lens_and_white_balance():
    light = ramp(stops=3)
    falloff = np.broadcast_to(np.linspace(0.5, 1, 64, dtype=np.float32)[:, None], (64, 160)).copy()
    balance = (2.0, 1.0, 0.5)
    photographed = light * falloff[..., None] * np.array(balance, np.float32)
    view = view_of(photographed, (2.0**-5,), "ldr", falloff=falloff, white_balance=balance)
    display = Display(LINEAR, 2.0**-5)
    by_band = figures(view, np.ascontiguousarray(light) * 2.0**-5, observation=display)
    assert by_band["stops_median"] == pytest.approx(0.0, abs=0.02)


def test_of_a_large_view_so_many_samples_are_drawn():
    light = ramp(height=1600)
    view = view_of(light, (2.0**-11,))
    samples = recorded_light(LinearLight(1.0), torch.from_numpy(light.copy()), view)
    assert len(samples.recorded) == len(samples.rendered) == MOST_SAMPLES
    assert np.allclose(samples.recorded, samples.rendered, rtol=1e-5)
