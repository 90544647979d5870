"""Exposures from overlapping pixels, against what was exposed."""

import numpy as np
import pytest

from capture.check import developed_ratios
from capture.check.exposure_estimates import estimates, meant, raw_edges
from capture.pictures import reduced_pictures
from imaging.merge.ratios import Ratio
from imaging.optics.exposure import Exposure

from .brackets import photo, scene, seen_raw

LABELS = [Exposure(time=time) for time in (1 / 2, 1 / 8, 1 / 32, 1 / 128)]


def wrongly(seed: int, share: float = 0.05) -> list[Exposure]:
    """Draw shutter times that are off by 5 %."""
    error = np.random.default_rng(seed).normal(0, share, len(LABELS))
    return [one.with_time(one.time * float(np.exp(e))) for one, e in zip(LABELS, error, strict=True)]


def departures(estimated, truth: list[Exposure]) -> np.ndarray:
    """ln of the estimated over the true exposures, the common scale taken off."""
    off = np.log([one.exposure.scale / true.scale for one, true in zip(estimated, truth, strict=True)])
    return off - off.mean()


@pytest.mark.parametrize("seed", range(4))
def test_ratios_of_a_raw_bracket_are_right_to_a_thousandth(seed):
    truth = wrongly(seed)
    light = scene(seed, 320, 480)
    frames = [seen_raw(light, one, seed).linear for one in truth]
    labels = np.log([one.scale for one in LABELS])
    estimated = estimates(LABELS, raw_edges(frames, labels))
    off = departures(estimated, truth)
    assert np.abs(off).max() < 1.5e-3
    claimed = np.array([one.error for one in estimated]) * np.log(2)
    assert np.all(np.abs(off) < 4 * claimed)
    assert claimed.max() < 2e-3


def test_the_common_scale_is_that_of_the_labels():
    truth = wrongly(7)
    frames = [seen_raw(scene(7), one, 7).linear for one in truth]
    estimated = estimates(LABELS, raw_edges(frames, np.log([one.scale for one in LABELS])))
    assert np.mean([one.over_label for one in estimated]) == pytest.approx(0.0, abs=0.01)


def test_a_label_far_off_the_others_does_not_pull_them_along():
    truth = [LABELS[0], LABELS[1].with_time(1 / 4), *LABELS[2:]]
    frames = [seen_raw(scene(3), one, 3).linear for one in truth]
    estimated = estimates(LABELS, raw_edges(frames, np.log([one.scale for one in LABELS])))
    assert [one.over_label for one in estimated] == pytest.approx([0, 1, 0, 0], abs=0.03)


def test_large_frames_are_averaged_in_blocks_with_the_same_ratios(monkeypatch):
    truth = wrongly(1)
    monkeypatch.setattr(reduced_pictures, "ENOUGH", 20_000)
    frames = [seen_raw(scene(1, 320, 480), one, 1).linear for one in truth]
    assert frames[0].signal.size <= 20_000
    estimated = estimates(LABELS, raw_edges(frames, np.log([one.scale for one in LABELS])))
    assert np.abs(departures(estimated, truth)).max() < 3e-3


def test_round_names_of_shutter_times_are_what_they_stand_for():
    labels = [Exposure(time=time) for time in (1 / 4, 1 / 60, 1 / 1000)]
    truth = [Exposure(time=time) for time in (1 / 4, 1 / 64, 1 / 1024)]
    frames = [seen_raw(scene(2), one, 2).linear for one in truth]
    estimated = estimates(labels, raw_edges(frames, np.log([one.scale for one in labels])))
    assert [one.over_meant for one in estimated] == pytest.approx([0, 0, 0], abs=0.01)
    assert estimated[1].over_label == pytest.approx(np.log2(60 / 64), abs=0.01)
    # An industrial camera means 1/60 s as it says.
    frames = [seen_raw(scene(2), one, 2).linear for one in labels]
    estimated = estimates(labels, raw_edges(frames, np.log([one.scale for one in labels])))
    assert [one.over_meant for one in estimated] == pytest.approx([0, 0, 0], abs=0.01)
    assert estimated[1].over_label == pytest.approx(0, abs=0.01)


def test_where_pictures_do_not_overlap_the_label_stands():
    exposures = [Exposure(time=1.0), Exposure(time=1e-3)]
    frames = [seen_raw(np.full((64, 64, 3), 5.0), one, 0).linear for one in exposures]
    assert estimates(exposures, raw_edges(frames, np.log([one.scale for one in exposures]))) == [None, None]


def test_an_estimate_that_is_no_better_than_the_label_is_not_made():
    estimated = estimates(LABELS, {(0, 1): Ratio(np.log(4.4), 0.2), (2, 3): Ratio(np.log(4.4), 0.001)})
    assert estimated[:2] == [None, None]
    assert [one.over_label for one in estimated[2:]] == pytest.approx(
        [np.log2(1.1) / 2, -np.log2(1.1) / 2], 1e-3
    )


def developed_estimates(truth: list[Exposure], seed: int):
    patches = [
        reduced_pictures.of_photo(photo(scene(seed, 320, 480), one, seed).astype(np.float32) / 255).patches
        for one in truth
    ]
    codes = developed_ratios.codes_of(patches, meant(LABELS))
    curves = developed_ratios.curves([codes])
    return estimates(LABELS, developed_ratios.edges(codes, curves)), curves


def trendless(off: np.ndarray) -> np.ndarray:
    """Without the straight line over ln of exposure that no photograph tells from its curve."""
    x = meant(LABELS) - meant(LABELS).mean()
    return off - x * (x @ off) / (x @ x)


@pytest.mark.parametrize("seed", range(3))
def test_ratios_of_developed_photographs_are_found_with_their_curve(seed):
    truth = wrongly(seed + 20)
    estimated, _ = developed_estimates(truth, seed)
    off = trendless(departures(estimated, truth))
    before = trendless(
        departures([type(one)(label, 0, 0, 0) for one, label in zip(estimated, LABELS, strict=True)], truth)
    )
    assert np.abs(off).max() < 0.01
    assert np.abs(off).max() < 0.4 * np.abs(before).max()


def test_the_frame_around_a_scan_tells_no_exposure():
    truth = wrongly(31)
    pictures = [photo(scene(5, 320, 480), one, 5) for one in truth]
    for picture in pictures:
        picture[:60] = 120
    patches = [reduced_pictures.of_photo(picture.astype(np.float32) / 255).patches for picture in pictures]
    codes = developed_ratios.codes_of(patches, meant(LABELS))
    estimated = estimates(LABELS, developed_ratios.edges(codes, developed_ratios.curves([codes])))
    assert np.abs(trendless(departures(estimated, truth))).max() < 0.01


def test_two_exposures_tell_nothing_of_a_curve_and_its_ratio():
    patches = [
        reduced_pictures.of_photo(photo(scene(0), one).astype(np.float32) / 255).patches for one in LABELS[:2]
    ]
    assert developed_ratios.curves([developed_ratios.codes_of(patches, meant(LABELS[:2]))]) is None
