"""Metrics against published values, closed forms and a direct implementation."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging import metrics
from imaging.metrics import (
    PSNR_CAP,
    STOPS_CAP,
    align_scale,
    hdr_psnr_mu,
    hdr_psnr_mu_below,
    hdr_psnr_mu_dark,
    mu_law,
    psnr,
    pu21,
    pu21_psnr,
    relative_error_by_decade,
    ssim,
    stops_median,
)

RNG = np.random.default_rng(11)
TRUTH = 10 ** RNG.uniform(-4, 2, (40, 50, 3))


def test_pu21_at_the_published_points() -> None:
    assert pu21(100.0) == pytest.approx(256.384, abs=2e-3)
    assert pu21(1000.0) == pytest.approx(420.097, abs=2e-3)
    assert pu21(0.0) == pu21(0.005)
    assert pu21(1e9) == pu21(1e4)
    assert np.all(np.diff(pu21(np.geomspace(0.005, 1e4, 500))) > 0)


def test_mu_law_by_its_formula() -> None:
    assert mu_law(0.0) == 0.0
    assert mu_law(1.0) == pytest.approx(1.0)
    assert mu_law(1 / 5000) == pytest.approx(math.log(2) / math.log(5001))
    assert mu_law(0.5, mu=10) == pytest.approx(math.log(6) / math.log(11))


@settings(max_examples=300)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_mu_law_is_odd_and_finite(value: float) -> None:
    assert math.isfinite(float(mu_law(value)))
    assert mu_law(-value) == -mu_law(value)


def test_psnr_in_closed_form() -> None:
    black = np.zeros((5, 6))
    assert psnr(black + 0.1, black) == pytest.approx(20.0)
    assert psnr(black + 0.1, black, peak=10) == pytest.approx(40.0)
    assert psnr(black + 255, black, peak=255) == pytest.approx(0.0)
    assert psnr(black, black) == PSNR_CAP
    assert psnr(black + 1e-12, black) == PSNR_CAP


def naive_ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Wang et al. 2004, window by window."""
    axis = np.arange(-5, 6)
    window = np.exp(-(axis[:, None] ** 2 + axis**2) / (2 * 1.5**2))
    window /= window.sum()
    values = []
    for row in range(a.shape[0] - 10):
        for column in range(a.shape[1] - 10):
            p, q = a[row : row + 11, column : column + 11], b[row : row + 11, column : column + 11]
            mp, mq = (window * p).sum(), (window * q).sum()
            vp, vq = (window * (p - mp) ** 2).sum(), (window * (q - mq) ** 2).sum()
            c = (window * (p - mp) * (q - mq)).sum()
            values.append((2 * mp * mq + 1e-4) * (2 * c + 9e-4) / ((mp**2 + mq**2 + 1e-4) * (vp + vq + 9e-4)))
    return float(np.mean(values))


def test_ssim_is_the_mean_of_its_windows() -> None:
    a = RNG.random((19, 23))
    b = np.clip(a + RNG.normal(0, 0.2, a.shape), 0, 1)
    assert ssim(a, b) == pytest.approx(naive_ssim(a, b), abs=1e-12)
    three = np.stack([a, b, a], axis=-1)
    other = np.stack([b, b, a], axis=-1)
    assert ssim(three, other) == pytest.approx((naive_ssim(a, b) + 2) / 3, abs=1e-12)


def test_ssim_of_a_masked_image_is_the_mean_of_its_whole_windows() -> None:
    a, b = RNG.random((2, 24, 30, 3))
    valid = np.ones(a.shape, bool)
    valid[:7], valid[20, 3, 1] = False, False
    a[:7], b[20, 3, 1] = 7.0, -1.0
    rows = [naive_ssim(a[y : y + 11, x : x + 11, c], b[y : y + 11, x : x + 11, c])
            for c in range(3) for y in range(7, 14) for x in range(20)
            if valid[y : y + 11, x : x + 11, c].all()]  # fmt: skip
    assert len(rows) == 3 * 7 * 20 - 16
    assert ssim(a, b, valid) == pytest.approx(np.mean(rows), abs=1e-12)
    assert ssim(a, b, valid & False) is None


def test_ssim_of_constant_images_in_closed_form() -> None:
    flat = np.ones((12, 13))
    for x, y in ((0.2, 0.7), (0.0, 1.0), (0.5, 0.5)):
        expected = (2 * x * y + 1e-4) / (x * x + y * y + 1e-4)
        assert ssim(x * flat, y * flat) == pytest.approx(expected, abs=1e-12)


def test_ssim_of_equal_images_is_one() -> None:
    assert ssim(TRUTH / 100, TRUTH / 100) == pytest.approx(1.0)
    assert ssim(np.zeros((11, 11)), np.zeros((11, 11))) == pytest.approx(1.0)
    for shape in ((10, 30), (30,), (1, 3, 30, 30)):
        with pytest.raises(ValueError, match="11 x 11"):
            ssim(np.zeros(shape), np.zeros(shape))


def test_a_scale_error_caps_the_mu_psnr_as_documented() -> None:
    # METHODS: a scale error of 10 % alone caps it at 39-40 dB
    light = RNG.uniform(0, 1, (60, 60, 3)) ** 2
    assert 38.0 < hdr_psnr_mu(1.1 * light, light) < 41.5
    scale = align_scale(1.1 * light, light)
    assert scale == pytest.approx(1 / 1.1, rel=1e-12)
    assert hdr_psnr_mu(scale * 1.1 * light, light) > 140


def test_the_peak_is_that_of_the_scene() -> None:
    light = np.full((4, 4), 2.0)
    dark = np.full((4, 4), 1.0)
    by_hand = -20 * math.log10(float(mu_law(0.5) - mu_law(0.25)))
    assert hdr_psnr_mu(dark, light, peak=4.0) == pytest.approx(by_hand)
    assert hdr_psnr_mu(dark, light) == pytest.approx(-20 * math.log10(float(1 - mu_law(0.5))))


def test_highlights_do_not_count_in_the_dark() -> None:
    truth = np.array([[0.1, 0.2, 0.5, 1.0]])
    assert hdr_psnr_mu_dark(np.array([[0.1, 0.2, 0.9, 0.6]]), truth) == PSNR_CAP
    worse = np.array([[0.1, 0.1, 0.5, 1.0]])
    by_hand = -10 * math.log10(float(mu_law(0.5) - mu_law(0.25)) ** 2 / 4)
    assert hdr_psnr_mu_dark(worse, truth) == pytest.approx(by_hand)


def test_a_lamp_lifts_no_figure_over_a_percentile() -> None:
    """Over the brightest light a lamp of 16,000 makes the same error of a grey world decibels smaller."""
    truth = np.full((100, 100), 9.0)
    light = 1.2 * truth
    lamp = truth.copy()
    lamp[0, :5] = 16_000.0
    too_bright = np.where(lamp > 100, 14_000.0, light)
    most = float(np.percentile(lamp, 99.9))
    assert most == 9.0
    assert hdr_psnr_mu(too_bright, lamp) > hdr_psnr_mu(light, truth) + 2
    by_hand = -20 * math.log10(float(mu_law(0.9) - mu_law(0.8)))
    assert hdr_psnr_mu_below(np.full(4, 0.9), np.full(4, 0.8), 1.0) == pytest.approx(by_hand)
    assert hdr_psnr_mu_below(np.full(4, 7.0), np.full(4, 3.0), 1.0) == PSNR_CAP
    assert hdr_psnr_mu_below(too_bright, lamp, 20.0) == pytest.approx(
        hdr_psnr_mu_below(light, truth, 20.0), abs=0.01
    )


def test_one_scale_puts_both_on_the_display() -> None:
    truth = np.array([[1.0, 10.0]])
    error = (float(pu21(1000.0)) - float(pu21(500.0))) ** 2 / 2
    assert pu21_psnr(np.array([[1.0, 5.0]]), truth) == pytest.approx(10 * math.log10(256**2 / error))
    error = (float(pu21(100.0)) - float(pu21(50.0))) ** 2 / 2
    assert pu21_psnr(np.array([[1.0, 5.0]]), truth, 200.0, 20.0) == pytest.approx(
        10 * math.log10(256**2 / error)
    )


def test_stops() -> None:
    assert stops_median(4 * TRUTH, TRUTH) == pytest.approx(2.0)
    assert stops_median(TRUTH / 8, TRUTH) == pytest.approx(3.0)
    assert stops_median(TRUTH, TRUTH) == 0.0
    assert stops_median(np.array([2.0, 0.0, 2.0, -1.0]), np.array([1.0, 1.0, 1.0, 0.0])) == pytest.approx(1.0)
    assert stops_median(np.zeros(5), np.ones(5)) == STOPS_CAP
    assert stops_median(np.ones(5), np.zeros(5)) == 0.0


def test_stops_of_a_part_of_the_light() -> None:
    truth = np.arange(1.0, 101.0)
    light = np.where(truth <= 10, 4 * truth, np.where(truth > 99, truth / 2, truth))
    assert stops_median(light, truth) == 0.0
    assert stops_median(light, truth, (0.0, 0.1)) == pytest.approx(2.0)
    assert stops_median(light, truth, (0.99, 1.0)) == pytest.approx(1.0)
    black = np.concatenate([np.zeros(500), truth])
    assert stops_median(np.concatenate([np.ones(500), light]), black, (0.0, 0.1)) == pytest.approx(2.0)
    assert stops_median(light, 0 * truth, (0.0, 0.1)) == 0.0


def test_a_bound_is_broken_on_one_side_only() -> None:
    """A photograph that clips says that the light is 8 at least, one that is black that it is 8 at most."""
    light, bound = np.array([4.0, 8.0, 64.0]), np.full(3, 8.0)
    clipped = [stops_median(light[[n]], bound[[n]], at_least=np.array([True])) for n in range(3)]
    assert clipped == pytest.approx([1.0, 0.0, 0.0])
    black = [stops_median(light[[n]], bound[[n]], at_most=np.array([True])) for n in range(3)]
    assert black == pytest.approx([0.0, 0.0, 3.0])
    assert stops_median(np.zeros(1), np.ones(1), at_least=np.array([True])) == STOPS_CAP
    assert stops_median(np.zeros(1), np.ones(1), at_most=np.array([True])) == 0.0


def test_bounds_count_among_a_part_of_the_light() -> None:
    truth = np.minimum(np.arange(1.0, 101.0), 91)
    clipped = truth == 91
    assert stops_median(np.full(100, 364.0), truth, (0.9, 1.0), at_least=clipped) == 0.0
    assert stops_median(np.full(100, 22.75), truth, (0.9, 1.0), at_least=clipped) == pytest.approx(2.0)
    assert stops_median(np.full(100, 364.0), truth, (0.9, 1.0)) == pytest.approx(2.0)


def test_alignment_is_robust_and_ignores_darkness() -> None:
    prediction = TRUTH / 3
    prediction[:10] = 0.0
    prediction[10:15] *= 100
    assert align_scale(prediction, TRUTH) == pytest.approx(3.0)
    assert align_scale(np.zeros(3), np.ones(3)) == 1.0


def test_decades() -> None:
    truth = np.array([0.0, -1.0, 0.5, 0.2, 0.1, 5.0, 10.0, 99.0])
    prediction = np.array([9.0, 9.0, 0.6, 0.2, 0.1, 5.0, 5.0, 99.0])
    rows = relative_error_by_decade(prediction, truth)
    assert [(row["low"], row["high"], row["count"]) for row in rows] == [
        (0.1, 1.0, 3),
        (1.0, 10.0, 1),
        (10.0, 100.0, 2),
    ]
    assert [row["median"] for row in rows] == pytest.approx([0.0, 0.0, 0.25])
    assert rows[0]["p95"] == pytest.approx(0.18)
    assert relative_error_by_decade(np.ones(4), np.zeros(4)) == []


FINITE = st.floats(allow_nan=False, allow_infinity=False)

ALL = [
    psnr,
    hdr_psnr_mu,
    hdr_psnr_mu_dark,
    pu21_psnr,
    ssim,
    align_scale,
    stops_median,
    relative_error_by_decade,
]


@pytest.mark.parametrize("metric", ALL)
def test_black_images_give_json(metric: object) -> None:
    black, grey = np.zeros((16, 16, 3)), np.full((16, 16, 3), 0.5)
    for prediction, truth in (
        (black, black),
        (black, grey),
        (grey, black),
        (-grey, grey),
        (1e-300 * grey, 1e-300 * grey),
    ):
        json.dumps(metric(prediction, truth), allow_nan=False)


@settings(max_examples=200)
@given(st.lists(st.tuples(FINITE, FINITE), min_size=1, max_size=6))
def test_no_numbers_give_infinity(pairs: list[tuple[float, float]]) -> None:
    prediction, truth = np.array(pairs).T
    for metric in ALL:
        if metric is not ssim:  # of images on 0..1
            json.dumps(metric(prediction, truth), allow_nan=False)


@pytest.mark.parametrize("metric", ALL)
def test_what_cannot_be_compared_is_refused(metric: object) -> None:
    image = np.full((16, 16, 3), 0.5)
    spoilt = image.copy()
    for bad in (np.nan, np.inf):
        spoilt[3, 4, 1] = bad
        with pytest.raises(ValueError, match="NaN or infinity"):
            metric(spoilt, image)
        with pytest.raises(ValueError, match="NaN or infinity"):
            metric(image, spoilt)
    with pytest.raises(ValueError, match="shape"):
        metric(image, image[..., :1])
    with pytest.raises(ValueError, match="nothing"):
        metric(image[:0], image[:0])


@pytest.mark.parametrize("peak", [float("nan"), float("inf"), -1.0])
def test_a_peak_that_cannot_be_is_refused(peak: float) -> None:
    for metric in (hdr_psnr_mu, hdr_psnr_mu_dark, psnr):
        with pytest.raises(ValueError, match="peak"):
            metric(TRUTH, TRUTH, peak)


def test_integers_are_taken_as_numbers() -> None:
    a = np.array([[0, 255]], np.uint8)
    b = np.array([[255, 0]], np.uint8)
    assert psnr(a, b, peak=255) == pytest.approx(0.0)


def test_the_window_is_that_of_the_paper() -> None:
    image = np.zeros((11, 11))
    image[5, 5] = 1.0
    assert metrics._window(image)[0, 0] == pytest.approx(
        (1 / np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2).sum()) ** 2
    )
