"""Response curves against those that made the codes, and the cases in which none can be measured."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.data.views import scene_views
from calib.light import radiometry
from calib.light.curves.codes import Patches, Samples, patches, pedestal, sample
from calib.light.curves.response import Estimate, estimate
from calib.light.curves.response_curve import channels_of
from capture.imports.photos import import_photos
from imaging.colour.spaces import srgb_encode
from imaging.merge.linear_frame import decode
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.session.calibration import Response
from imaging.session.session import Session
from tests.calib.conftest import make_session

Curve = Callable[[np.ndarray], np.ndarray]

FAMILIES: dict[str, Curve] = {
    "gamma": lambda x: x ** (1 / 2.2),
    "s-curve": lambda x: 1.21 * x**1.12 / (x**1.12 + 0.21),
    "log": lambda x: np.log1p(60 * x) / np.log(61),
    "bt709": lambda x: np.where(x < 0.018, 4.5 * x, 1.099 * np.maximum(x, 1e-9) ** 0.45 - 0.099),
}
STEPS = np.log(2.0 ** np.array([-6.0, -4.0, -2.0, 0.0, 2.0]))


def smooth(rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """Light [120, 160, 3] between two values, evenly in its logarithm."""
    knots = rng.uniform(np.log(low), np.log(high), (7, 10, 3))
    rows, columns = np.linspace(0, 5.999, 120), np.linspace(0, 8.999, 160)
    r, c = rows.astype(int), columns.astype(int)
    fr, fc = (rows - r)[:, None, None], (columns - c)[None, :, None]
    top = knots[r][:, c] * (1 - fc) + knots[r][:, c + 1] * fc
    bottom = knots[r + 1][:, c] * (1 - fc) + knots[r + 1][:, c + 1] * fc
    return np.exp(top * (1 - fr) + bottom * fr)


def shoot(curve: Curve, log_k: np.ndarray, seed: int = 0, views: int = 4, moved: float = 0.0) -> Samples:
    """Noisy 8-bit exposures of smooth scenes: 3,000 electrons at white."""
    parts = []
    for view in range(views):
        rng = np.random.default_rng((seed, view))
        light = smooth(rng, 1e-2, 30.0)
        shots = []
        for step in log_k:
            x = rng.poisson(np.minimum(light * np.exp(step), 4) * 3000) / 3000
            code = np.rint(255 * curve(np.clip(x, 0, 1))) / 255
            if moved and step == log_k[-1]:
                code = np.roll(code, round(moved * 160), axis=1)
            shots.append(patches(code))
        parts.append(sample(shots, log_k, 400))
    return Samples.joined(parts)


def rmse(response: Response, curve: Curve) -> float:
    """Root mean square error of ln E over codes 10..245, free of scale; worst of the channels."""
    x = np.geomspace(1e-5, 1, 20_000)
    codes = np.arange(10, 246) / 255
    truth = np.interp(codes, curve(x), np.log(x))
    decoded = np.log(decode(np.repeat(codes[:, None], 3, axis=1), response).astype(np.float64))
    return float((decoded - truth[:, None]).std(axis=0).max())


@cache
def measured(family: str) -> Estimate:
    """The response of a bracket of five exposures."""
    return estimate(shoot(FAMILIES[family], STEPS))


@pytest.mark.parametrize("family", FAMILIES)
def test_curve_is_the_one_that_made_the_codes(family: str) -> None:
    estimated = measured(family)
    response = estimated.response
    assert response.kind == "curve"
    assert any(rung.taken for rung in estimated.rungs)
    assert rmse(response, FAMILIES[family]) < 0.02
    assert all((np.diff(row) > 0).all() for row in response.log_exposure)
    assert all(np.diff(response.codes) > 0)
    assert 0 < response.valid[0] < 0.1
    assert 0.9 < response.valid[1] < 1
    assert response.residual is not None
    assert response.residual < 0.06


def test_srgb_is_recognised_and_needs_no_curve() -> None:
    estimated = estimate(shoot(srgb_encode, STEPS))
    assert estimated.response.kind == "srgb"
    assert not any(rung.taken for rung in estimated.rungs)
    assert estimated.response.residual is not None
    assert "agree with it" in estimated.response.evidence


def test_wrong_labels_are_corrected_within_their_trust() -> None:
    true = STEPS + np.array([0.0, 0.04, -0.05, 0.03, 0.0])
    samples = shoot(FAMILIES["gamma"], true)
    labelled = Samples(samples.codes, np.broadcast_to(STEPS, samples.log_k.shape).copy(), samples.group)
    estimated = estimate(labelled)
    shift = np.array([estimated.shift[round(step, 6)] for step in STEPS])
    # Scale and exponent are those of the labels: what is told is the departure from a straight line.
    line = np.polynomial.Polynomial.fit(STEPS, true - STEPS, 1)
    np.testing.assert_allclose(shift, true - STEPS - line(STEPS), atol=0.01)
    assert rmse(estimated.response, FAMILIES["gamma"]) < 0.03


def test_motion_in_one_exposure_is_borne() -> None:
    estimated = estimate(shoot(FAMILIES["gamma"], STEPS, moved=0.02))
    assert rmse(estimated.response, FAMILIES["gamma"]) < 0.05


def test_two_exposures_are_enough_for_a_usable_curve() -> None:
    estimated = estimate(shoot(FAMILIES["s-curve"], STEPS[1:4:2], views=6))
    assert estimated.response.kind == "curve"
    assert rmse(estimated.response, FAMILIES["s-curve"]) < 0.1


def test_a_third_exposure_that_is_black_changes_nothing() -> None:
    """Hardly a code of it counts: it is no third exposure that would let the other two depart."""
    estimated = estimate(shoot(FAMILIES["gamma"], np.log([2.0**-13, 2.0**-4, 2.0**-2]), views=2))
    assert rmse(estimated.response, FAMILIES["gamma"]) < 0.05
    assert list(estimated.shift) == np.log([2.0**-4, 2.0**-2]).round(6).tolist()
    assert any("two exposures do not determine a ratio" in rung.reason for rung in estimated.rungs)


def test_views_of_fewer_exposures_bring_no_label_of_their_own() -> None:
    two, three = shoot(srgb_encode, STEPS[1:3], views=1), shoot(srgb_encode, STEPS[[1, 2, 2]], views=1)
    joined = Samples.joined([two, three])
    assert set(np.unique(joined.log_k)) == set(STEPS[1:3])
    assert [channel.steps.tolist() for channel in channels_of(joined)] == [STEPS[1:3].round(6).tolist()] * 3


def test_under_coloured_light_codes_of_any_channel_are_valid() -> None:
    """Blue has no bright code and red no dark one: of both together there would be next to none."""
    samples = shoot(FAMILIES["gamma"], np.log(2.0 ** np.arange(-5.0, 2.0)), views=2)
    darkest, brightest = np.array([128.0, 5.0, 5.0]), np.array([248.0, 248.0, 100.0])
    inside = (samples.codes >= darkest) & (samples.codes <= brightest)
    tinted = Samples(np.where(inside, samples.codes, np.nan), samples.log_k, samples.group)
    response = estimate(tinted).response
    low, high = response.valid
    assert response.kind == "curve"
    assert low < 0.05
    assert high > 0.9


@pytest.mark.parametrize("cells", [[10], [5, 11, 17]], ids=["one cell", "cells of one fold"])
def test_masks_may_leave_any_cells(cells: list[int]) -> None:
    samples = shoot(FAMILIES["gamma"], STEPS[1:4], views=2)
    group = np.array(cells)[np.arange(len(samples.group)) % len(cells)]
    estimated = estimate(Samples(samples.codes, samples.log_k, group))
    assert estimated.response.residual is not None
    assert rmse(estimated.response, FAMILIES["gamma"]) < 0.02


def flat(code: float) -> Samples:
    plain = np.full((40, 40, 3), code, np.float32)
    return sample([Patches(plain, plain, plain)] * 3, STEPS[:3], 500)


@pytest.mark.parametrize("family", ["gamma", "s-curve"])
def test_the_band_holds_the_curve(family: str) -> None:
    response = measured(family).response
    codes, sigma = np.array(response.codes), np.array(response.sigma)
    light = np.geomspace(1e-6, 1, 100_000)
    truth = np.interp(codes, FAMILIES[family](light), np.log(light))
    curve = np.array(response.log_exposure)
    middle = np.flatnonzero(codes.round(4) == round(128 / 255, 4))[0]
    away = curve - curve[:, [middle]] - (truth - truth[middle])
    inside = (codes > response.valid[0]) & (codes < response.valid[1]) & (sigma[0] > 1e-4)
    assert (np.abs(away) < 1.96 * sigma)[:, inside].mean() > 0.75
    assert np.median(sigma[:, inside]) < 0.02
    assert sigma[:, 0].min() >= sigma[:, inside].min()


def relabelled(samples: Samples, labels: np.ndarray) -> Samples:
    return Samples(samples.codes, np.broadcast_to(labels, samples.log_k.shape).copy(), samples.group)


@pytest.mark.parametrize(("step", "factor"), [(0, 2.0), (1, 0.5), (3, 0.5)])
def test_a_label_that_is_wrong_by_two_is_found_and_named(step: int, factor: float) -> None:
    """Try four exposures, wherever it is; the others and the curve stay right.

    A black one before them counts where exposures are numbered.
    """
    labels = STEPS[:4]
    off = np.where(np.arange(4) == step, np.log(factor), 0.0)
    shot, black = relabelled(shoot(FAMILIES["gamma"], labels + off), labels), int(factor > 1)
    codes = np.pad(shot.codes, ((0, 0), (black, 0), (0, 0)), constant_values=np.nan)
    log_k = np.pad(shot.log_k, ((0, 0), (black, 0)), constant_values=labels[0] - 5.0)
    estimated = estimate(Samples(codes, log_k, shot.group))
    shift = np.array([estimated.shift[round(label, 6)] for label in labels])
    np.testing.assert_allclose(np.delete(shift, step), 0.0, atol=0.01)
    assert abs(shift[step] - off[step]) < 0.02
    assert rmse(estimated.response, FAMILIES["gamma"]) < 0.01
    rung = next(rung for rung in estimated.rungs if rung.name == "exposure_labels")
    assert rung.taken
    times = f"{np.exp(shift[step]):.3g} times its label"
    message = f"; exposure {step + 1 + black} of {len(labels) + black}, counted from the shortest, is {times}"
    assert rung.reason.endswith(message)
    assert estimated.response.evidence.endswith(message)


def test_of_three_labels_that_contradict_each_other_none_is_named() -> None:
    labels = STEPS[1:4]
    estimated = estimate(
        relabelled(shoot(FAMILIES["gamma"], labels + np.array([np.log(2), 0.0, 0.0])), labels)
    )
    assert "contradict each other" in estimated.response.evidence
    assert "take four or more" in estimated.response.evidence


def test_a_wide_bracket_does_not_ripple_the_curve() -> None:
    """Exposures four stops apart say nothing of ripples of that period; half-way steps would show them."""
    curve = lambda x: (x / (1 + x)) ** (1 / 2.2)  # noqa: E731
    logs = np.log([1 / 8, 2.0, 32.0])
    parts = []
    for view in range(4):
        light = smooth(np.random.default_rng((3, view)), 2e-3, 160.0)
        shots = [patches(np.rint(255 * curve(light * np.exp(log))) / 255) for log in logs]
        parts.append(sample(shots, logs, 800))
    response = estimate(Samples.joined(parts)).response
    x = np.geomspace(1e-5, 1e3, 40_000)
    codes = np.arange(10, 246) / 255
    truth = np.interp(codes, curve(x), np.log(x))
    away = np.log(decode(np.repeat(codes[:, None], 3, axis=1), response).astype(float)) - truth[:, None]
    assert away.std(axis=0).max() < 0.01
    beyond = np.interp(truth + np.log(4.0), truth, codes, right=np.nan)
    across = np.stack([np.interp(beyond, codes, channel) - channel for channel in away.T])
    assert np.sqrt(np.nanmean(across**2, axis=1)).max() < 0.015


@pytest.mark.parametrize("factor", [2.0, 4.0], ids=["a label of its own", "another's label"])
def test_one_photograph_with_a_wrong_label_spoils_nothing(tmp_path: Path, factor: float) -> None:
    """All others of its step are right: its exposure is put right, and named if its label is another's."""
    labels, views = np.exp(STEPS[:4]), []
    for view in range(3):
        light = smooth(np.random.default_rng((7, view)), 1e-1, 30.0)
        codes = [np.rint(255 * np.clip(light * k, 0, 1) ** (1 / 2.2)).astype(np.uint8) for k in labels]
        times = labels * np.where((np.arange(4) == 2) & (view == 1), factor, 1.0)
        views.append(
            [
                (code, Exposure(time=float(t), f_number=1, iso=100))
                for code, t in zip(codes, times, strict=True)
            ]
        )
    session = Session.open(make_session(tmp_path / "S", views))
    placed = scene_views(session)
    light = radiometry.measure_light(session, placed, unreported)
    for view in placed:
        scales = [light.scale[shot.file] for shot in view.shots]
        np.testing.assert_allclose(scales, labels, rtol=0.02)
    (response,) = light.responses.values()
    assert rmse(response, FAMILIES["gamma"]) < 0.01
    wrong = placed[1].shots[2].file
    named = [rung.reason for rung in light.rungs if rung.name == "exposure_of_a_file"]
    assert named == ([f"the exposure of {wrong} is 0.25 times its label"] if factor == 4.0 else [])


def test_brackets_of_many_steps_keep_their_labels(tmp_path: Path) -> None:
    """Noise lifts the dark into the codes of exposures that share no light: it puts no label right."""
    labels, views = np.exp(np.log(4.0) * np.arange(-6.0, 1.0)), []
    for view in range(2):
        light = smooth(np.random.default_rng((8, view)), 0.3, 3e3)
        shots = []
        for index, k in enumerate(labels):
            code = np.rint(255 * FAMILIES["s-curve"](np.clip(light * k, 0, 1))).astype(np.uint8)
            lifted = np.random.default_rng((9, view, index)).random((15, 20)) < 0.5
            code[(code < 5) & np.kron(lifted, np.ones((8, 8), bool))[..., None]] = 6
            shots.append((code, Exposure(time=float(k), f_number=1, iso=100)))
        views.append(shots)
    session = Session.open(make_session(tmp_path / "S", views))
    placed = scene_views(session)
    light = radiometry.measure_light(session, placed, unreported)
    for view in placed:
        np.testing.assert_allclose([light.scale[shot.file] for shot in view.shots], labels, rtol=0.1)


def test_brackets_that_nothing_ties_keep_their_labels() -> None:
    """Photographs of two views without a label in common have no ratio but that of their labels."""
    labels = STEPS[:3], STEPS[2:] + np.log(1.5)
    parts = []
    for seed, steps in enumerate(labels):
        part = shoot(FAMILIES["log"], steps + seed * np.log([1.0, 1.3, 1.0]), seed, views=2)
        parts.append(replace(part, log_k=np.broadcast_to(steps, part.log_k.shape).copy()))
    estimated = estimate(Samples.joined(parts))
    assert max(map(abs, estimated.shift.values())) < 0.05
    (rung,) = (rung for rung in estimated.rungs if rung.name == "exposure_labels")
    assert not rung.taken


def test_the_base_of_a_film_tells_no_light() -> None:
    short = STEPS - np.log(64.0)
    samples = shoot(lambda x: 0.08 + 0.92 * np.maximum(x - 1e-3, 0) ** (1 / 2.2), short, views=1)
    assert 20 <= pedestal(samples.codes[..., 0], samples.log_k) <= 40
    plain = shoot(FAMILIES["log"], STEPS, views=1)
    assert pedestal(plain.codes[..., 0], plain.log_k) == 0


@pytest.mark.parametrize(
    "samples",
    [
        None,
        flat(255.0),
        flat(0.0),
        shoot(FAMILIES["gamma"], np.zeros(3)),
        shoot(FAMILIES["gamma"], STEPS[:1]),
        shoot(FAMILIES["gamma"], np.log([2.0**-14, 2.0**6])),
    ],
    ids=["no bracket", "all saturated", "all dark", "one exposure thrice", "one exposure", "20 stops apart"],
)
def test_srgb_is_assumed_and_said_so_where_nothing_can_be_measured(samples: Samples | None) -> None:
    estimated = estimate(samples)
    assert estimated.response.kind == "srgb"
    assert estimated.response.residual is None
    assert "assumed" in estimated.response.evidence
    assert "take" in estimated.response.evidence
    assert "1 to 3 stops apart" in estimated.response.evidence
    assert estimated.shift == {}


def test_a_real_bracket_of_photographs(real: Path, tmp_path: Path) -> None:
    """Seven JPEGs of a Canon: sRGB is useless for them (0.64 disagreement), a curve is not (0.07)."""
    import_photos(real / "t2i", tmp_path / "S", on_progress=unreported)
    session = Session.open(tmp_path / "S")
    light = radiometry.measure_light(session, scene_views(session), unreported)
    (response,) = light.responses.values()
    assert response.kind == "curve"
    assert response.residual is not None
    assert response.residual < 0.1
    assert all((np.diff(row) > 0).all() for row in response.log_exposure)
    assert light.measured
    assert len(light.scale) == 7
