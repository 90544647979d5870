"""Cameras that differ, in one scene: RAW beside photographs, other sizes, other phases of the mosaic."""

import numpy as np
import pytest

from imaging.cfa import BAYER, Cfa
from imaging.errors import ReconstructionError
from recon.data.truth import true_radiance

from .conftest import as_exr, joined


@pytest.fixture(scope="module")
def raw_and_photographs(studio, tmp_path_factory):
    return joined(studio.session("toy"), studio.session("toy-ldr"), tmp_path_factory.mktemp("one") / "mixed")


@pytest.mark.parametrize("method", ["auto", "vanilla"])
def test_raw_beside_photographs_is_as_right_as_raw_alone(studio, train, raw_and_photographs, method):
    """In the mean over seeds: that of one training scatters by a twentieth."""
    alone, both = (
        [train(session, method, seed) for seed in range(3)]
        for session in (studio.session("toy"), raw_and_photographs)
    )
    stops = [np.mean([outcome.stops() for outcome in outcomes]) for outcomes in (alone, both)]
    assert stops[0] < 0.45
    assert stops[1] < 1.1 * stops[0]
    for outcome in both:
        assert "raw_psnr" in outcome.metrics
        assert outcome.metrics["response_rmse"] < 0.02


def test_photographs_beside_raw_are_as_right_as_photographs_alone(studio, train, tmp_path):
    """The held-out view is now a photograph."""
    ldr = studio.session("toy-ldr")
    both = train(joined(ldr, studio.session("toy"), tmp_path / "mixed"))
    alone = train(ldr)
    assert alone.scene.record.settings.method == "hdr-gs"
    assert both.scene.record.settings.method == "nh-3dgs"
    assert both.stops() < 1.1 * alone.stops()
    assert both.metrics["ldr_psnr_oe"] > alone.metrics["ldr_psnr_oe"] - 1


def test_raw_beside_exr_needs_no_curve(studio, train, tmp_path):
    """The second camera's files are the true radiance; no tone curve is made for them."""
    raw = studio.session("toy")
    session = as_exr(raw, tmp_path / "mixed", lambda light: light, of=["cam1"])
    outcome = train(session)
    assert outcome.scene.dataset.kind == "mixed"
    assert not outcome.scene.training.method.observation.shared
    assert outcome.stops() < 1.1 * train(raw).stops()


def test_hdr_gs_refuses_what_is_not_all_photographs(train, raw_and_photographs):
    with pytest.raises(ReconstructionError, match=r"holds linear images.*use --method nh-3dgs\.$"):
        train(raw_and_photographs, "hdr-gs")


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("toy", {"width": 48, "height": 36}),
        ("toy-ldr", {"width": 40, "height": 40}),
        ("toy-ldr", {"width": 40, "height": 26}),
    ],
)
def test_cameras_of_different_sizes(studio, train, tmp_path, name, size):
    """Not much flatter ones: what lies above and below their images is told by half as many views."""
    small = studio.session(name)
    both = train(joined(small, studio.session(name, **size), tmp_path / "mixed"))
    assert len({view.shots[0].pixels.shape for view in both.scene.dataset.views}) == 2
    assert both.stops() < 1.15 * train(small).stops()


def test_held_out_views_of_different_sizes_are_pooled(studio, train, tmp_path):
    """Nine views or more hold out two, of one camera each."""
    small, large = (
        studio.session("toy", times=[1 / 60], positions=5, width=width, height=width * 3 // 4)
        for width in (32, 40)
    )
    both = train(joined(small, large, tmp_path / "mixed"))
    assert len({view.lens.width for view in both.scene.dataset.held_out}) == 2
    pixels = sum(entry["count"] for entry in both.metrics["relative_error_by_decade"])
    assert pixels == 3 * (32 * 24 + 40 * 30)
    assert both.metrics["stops_median"] < 0.6


def test_every_phase_of_the_mosaic_in_one_scene(studio, train):
    """Four cameras, each of its own phase, are as right as four of one phase; no colours are exchanged."""
    settings = {"cameras": 4, "positions": 1}
    one = train(studio.session("toy", phases=[Cfa.RGGB] * 4, **settings))
    all_four = train(studio.session("toy", phases=BAYER, **settings))
    assert {view.sensor.cfa for view in all_four.scene.dataset.views} == set(BAYER)
    assert all_four.stops() < 1.1 * one.stops()
    assert one.stops() < 0.5
    for view in all_four.scene.dataset.views:
        ratio = np.median(all_four.light(view) / true_radiance(all_four.scene.dataset.session, view), (0, 1))
        assert ratio.max() < 1.15 * ratio.min()
