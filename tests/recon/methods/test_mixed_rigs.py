"""Cameras that differ, in one scene: RAW beside photographs, other sizes, other phases of the mosaic."""

import numpy as np
import pytest

from imaging.errors import ReconstructionError
from imaging.sensor.cfa import BAYER, Cfa
from recon.measure.truth import true_radiance

from .conftest import as_exr, joined, mean_stops


@pytest.fixture(scope="module")
def raw_and_photographs(studio, tmp_path_factory):
    return joined(studio.session("toy"), studio.session("toy-ldr"), tmp_path_factory.mktemp("one") / "mixed")


@pytest.mark.parametrize("method", ["auto", "vanilla"])
def test_raw_beside_photographs_is_as_right_as_raw_alone(studio, train, raw_and_photographs, method):
    """Over more seeds than elsewhere, since both are hardly as right."""
    alone, both = (mean_stops(session, method, 3) for session in (studio.session("toy"), raw_and_photographs))
    assert alone < 0.45
    assert both < 1.1 * alone
    outcome = train(raw_and_photographs, method)
    assert "raw_psnr" in outcome.metrics
    assert outcome.metrics["response_rmse"] < 0.02


def test_photographs_beside_raw_are_as_right_as_photographs_alone(studio, train, tmp_path):
    """The held-out view is now a photograph."""
    ldr = studio.session("toy-ldr")
    mixed = joined(ldr, studio.session("toy"), tmp_path / "mixed")
    both, alone = train(mixed), train(ldr)
    assert alone.scene.record.settings.method == "hdr-gs"
    assert both.scene.record.settings.method == "nh-3dgs"
    assert mean_stops(mixed) < 1.1 * mean_stops(ldr)
    assert both.metrics["ldr_psnr_oe"] > alone.metrics["ldr_psnr_oe"] - 1


def test_raw_beside_exr_needs_no_curve(studio, train, tmp_path):
    """The second camera's files are the true radiance; no tone curve is made for them."""
    raw = studio.session("toy")
    session = as_exr(raw, tmp_path / "mixed", lambda light: light, of=["cam1"])
    outcome = train(session)
    assert outcome.scene.dataset.kind == "mixed"
    assert not outcome.scene.training.method.observation.shared
    assert mean_stops(session) < 1.1 * mean_stops(raw)


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
    mixed = joined(small, studio.session(name, **size), tmp_path / "mixed")
    assert len({view.shots[0].pixels.shape for view in train(mixed).scene.dataset.views}) == 2
    assert mean_stops(mixed) < 1.15 * mean_stops(small)


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
    of_one, of_four = (studio.session("toy", phases=phases, **settings) for phases in ([Cfa.RGGB] * 4, BAYER))
    one, all_four = train(of_one), train(of_four)
    assert {view.sensor.cfa for view in all_four.scene.dataset.views} == set(BAYER)
    assert mean_stops(of_four) < 1.1 * mean_stops(of_one)
    assert one.stops() < 0.5
    for view in all_four.scene.dataset.views:
        ratio = np.median(all_four.light(view) / true_radiance(all_four.scene.dataset.session, view), (0, 1))
        assert ratio.max() < 1.15 * ratio.min()
