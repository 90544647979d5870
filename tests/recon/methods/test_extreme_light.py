"""Light and exposures at their ends: the scene is right, or it is what the files still tell."""

import numpy as np
import pytest

from imaging.errors import ReconstructionError
from imaging.files.exr.reading import read_exr
from recon.data.light import light_of, radiance_image
from recon.decide.request import TrainingRequest
from recon.measure.truth import true_radiance
from recon.reconstruct import reconstruct

from .conftest import as_exr, in_other_units, mean_stops

EACH = [("toy", "nh-3dgs"), ("toy", "vanilla"), ("toy-ldr", "hdr-gs"), ("toy-ldr", "vanilla")]
MODELS_LIGHT = EACH[:3]
"""Without the display values of 3DGS, which have no idea of exposure."""


@pytest.mark.parametrize(("name", "method"), EACH)
def test_the_usual_session_is_right(studio, train, name, method):
    """Measure the reference of the others."""
    assert train(studio.session(name), method).stops() < (0.45 if (name, method) in MODELS_LIGHT else 0.8)


@pytest.mark.parametrize(("name", "method"), [EACH[0], EACH[2]])
def test_one_exposure(studio, train, name, method):
    outcome = train(studio.session(name, times=[1 / 60]), method)
    assert {len(view.shots) for view in outcome.scene.dataset.views} == {1}
    assert outcome.stops() < 0.65


@pytest.mark.parametrize(("name", "method"), MODELS_LIGHT)
def test_exposures_4096_apart(studio, train, name, method):
    session = studio.session(name, times=[1 / 8000, 1 / 2])
    outcome = train(session, method)
    short, long = (shot.k for shot in outcome.scene.dataset.train[0].shots)
    assert long / short == pytest.approx(2**12)
    assert mean_stops(session, method) < 1.25 * mean_stops(studio.session(name), method)


def test_display_values_of_exposures_4096_apart_are_finite(studio, train):
    """No single display value is right for both; `trained` checks that all numbers are finite."""
    outcome = train(studio.session("toy-ldr", times=[1 / 8000, 1 / 2]), "vanilla")
    assert outcome.metrics["ldr_psnr_oe"] > 10


@pytest.mark.parametrize(("name", "method"), MODELS_LIGHT)
def test_black_frames_give_a_scene_darker_than_the_noise(studio, train, name, method):
    outcome = train(studio.session(name, light=1e-7), method)
    for view in outcome.scene.dataset.views:
        brightest = np.percentile(outcome.light(view), 99) * max(shot.k for shot in view.shots)
        assert brightest < 5e-3


@pytest.mark.parametrize(("name", "method"), MODELS_LIGHT)
def test_saturated_frames_give_a_scene_as_bright_as_they_prove(studio, train, name, method):
    """All that is known is a lower bound: white at the shortest exposure."""
    outcome = train(studio.session(name, light=1e6), method)
    signal = outcome.metrics["raw_psnr" if name == "toy" else "ldr_psnr_oe"]
    assert signal > 60
    for view in outcome.scene.dataset.views:
        assert all(shot.saturated.all() for shot in view.shots)


@pytest.mark.parametrize(("name", "method"), MODELS_LIGHT)
def test_radiance_of_2_to_the_20(studio, train, tmp_path, name, method):
    """Multiply the light by that, at exposure scales that make the same files of it."""
    session = studio.session(name)
    scaled = in_other_units(session, tmp_path / "scaled", 2.0**20)
    assert mean_stops(scaled, method) < 1.1 * mean_stops(session, method)


@pytest.mark.parametrize(("method", "stops"), [("nh-3dgs", 20), ("vanilla", -20)])
def test_exr_of_any_scale(studio, train, tmp_path, method, stops):
    """Its exposure scale is 1 whatever its unit: nothing may be cut off by its absolute value."""
    usual = as_exr(studio.session("toy"), tmp_path / "usual", lambda light: light)
    scaled = as_exr(studio.session("toy"), tmp_path / "scaled", lambda light: light * 2.0**stops)
    assert train(scaled, method).scene.training.light.reference == 2.0**-20
    assert mean_stops(scaled, method, 2) < 1.1 * mean_stops(usual, method, 2)


@pytest.mark.parametrize("method", ["nh-3dgs", "vanilla"])
def test_a_contrast_of_20_stops(studio, train, tmp_path, method):
    """The hundredth of the scene that is darkest is at 1 on the median, its lamp at 2^20."""
    session = studio.session("toy")
    everything = np.concatenate(
        [read_exr(path).rgb().reshape(-1) for path in (session / "truth").rglob("*.exr")]
    )
    dark = np.percentile(everything, 1)
    bend = 20 / np.log2(everything.max() / dark)
    outcome = train(as_exr(session, tmp_path / "exr", lambda light: (light / dark) ** bend), method)
    assert outcome.stops() < 0.5
    view = outcome.scene.dataset.held_out[0]
    true = true_radiance(outcome.scene.dataset.session, view)
    light = outcome.light(view)
    assert abs(np.log2(light.max() / true.max())) < 1.5
    darkest = true < np.percentile(true, 10)
    assert np.median(np.abs(np.log2(light[darkest] / true[darkest]))) < 1.0


def test_exr_without_light(studio, train, tmp_path):
    """Light below zero: a black scene."""
    outcome = train(as_exr(studio.session("toy"), tmp_path / "exr", lambda light: 0.0 * light - 1.0))
    images = [radiance_image(view) for view in outcome.scene.dataset.train]
    assert light_of(outcome.scene.dataset, images).normaliser == 1.0
    assert all(outcome.light(view).max() < 1e-2 for view in outcome.scene.dataset.views)


def test_exr_without_numbers(studio, tmp_path):
    """Nothing but NaN: refused, since nothing says what is where."""
    session = as_exr(studio.session("toy"), tmp_path / "exr", lambda light: light * np.nan)
    with pytest.raises(ReconstructionError, match=r"shows 0 of its .* look at the images and the masks"):
        reconstruct(session, TrainingRequest(quality="draft"))
