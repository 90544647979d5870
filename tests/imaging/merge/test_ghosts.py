"""Motion is detected and shown once; noise that stands still is not; the shift of a camera is measured."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from imaging.merge.alignment import shifts
from imaging.merge.bracket import merge_bracket
from imaging.merge.ghosts import find_ghosts, without_ghosts
from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise
from imaging.sensor.cfa import Cfa

FULL_WELL, READ = 15_000.0, 4.0
NOISE = SensorSignalNoise(slope=1 / FULL_WELL, floor=(READ / FULL_WELL) ** 2)
SCALES = tuple(4.0**-n for n in range(5))
SIZE = (180, 240)
PHASES = pytest.mark.parametrize("cfa", [None, Cfa.RGGB], ids=["pixels", "mosaic"])


def scene(seed: int) -> np.ndarray:
    """Smooth light over six decades, with texture."""
    rng = np.random.default_rng(seed)
    broad = cv2.resize(
        rng.uniform(np.log(1e-4), np.log(100.0), (6, 8)), SIZE[::-1], interpolation=cv2.INTER_CUBIC
    )
    fine = cv2.resize(rng.standard_normal((60, 80)), SIZE[::-1], interpolation=cv2.INTER_CUBIC)
    return np.exp(broad + 0.5 * fine)


def expose(
    light: np.ndarray, k: float, rng: np.random.Generator, cfa: Cfa | None, noise=NOISE
) -> LinearFrame:
    electrons = rng.poisson(np.minimum(light * k, 3.0) * FULL_WELL) + READ * rng.standard_normal(light.shape)
    signal = np.minimum(electrons / FULL_WELL, 1.0).astype(np.float32)
    none = np.zeros(signal.shape, bool)
    return LinearFrame(signal, k, signal >= 1.0, none, ~none, cfa, noise, ceiling=1.0)


@PHASES
def test_noise_alone_is_no_ghost(cfa: Cfa | None) -> None:
    rng = np.random.default_rng(1)
    result = without_ghosts([expose(scene(0), k, rng, cfa) for k in SCALES])
    assert result.ghost.mean() < 1e-4
    assert result.noise < 1.1


@PHASES
def test_noise_of_twice_the_model_is_no_ghost_either(cfa: Cfa | None) -> None:
    rng = np.random.default_rng(2)
    quiet = SensorSignalNoise(NOISE.slope / 4, NOISE.floor / 4)
    result = without_ghosts([expose(scene(0), k, rng, cfa, quiet) for k in SCALES])
    assert result.ghost.mean() < 2e-3
    assert result.noise > 1.3


@PHASES
def test_what_moved_is_found_and_shown_as_one_exposure_saw_it(cfa: Cfa | None) -> None:
    rng = np.random.default_rng(3)
    still = np.full(SIZE, 0.02)
    path = np.zeros(SIZE, bool)
    frames = []
    for step, k in enumerate(SCALES):
        light = still.copy()
        place = (slice(40, 80), slice(20 + 30 * step, 50 + 30 * step))
        light[place] = 0.6
        path[place] = True
        frames.append(expose(light, k, rng, cfa))
    result = without_ghosts(frames)
    assert result.ghost[path].mean() > 0.9
    assert result.ghost[~path].mean() < 0.01
    # The longest exposure saw the object unsaturated at its first place, and so shows it there alone.
    assert result.reference == 0
    merged = result.merged.radiance
    assert np.median(merged[42:78, 22:48]) == pytest.approx(0.6, rel=0.02)
    for step in range(1, 5):
        assert np.median(merged[42:78, 22 + 30 * step : 48 + 30 * step]) == pytest.approx(0.02, rel=0.05)
    untouched = merge_bracket(frames)
    np.testing.assert_array_equal(merged[~result.ghost], untouched.radiance[~result.ghost])


def test_a_light_that_went_out_is_found_though_it_saturated() -> None:
    rng = np.random.default_rng(4)
    dark = np.full(SIZE, 0.01)
    lit = dark.copy()
    lit[50:90, 50:90] = 40.0
    frames = [expose(lit if k == 1.0 else dark, k, rng, None) for k in SCALES]
    ghost, _ = find_ghosts(frames, merge_bracket(frames))
    assert ghost[52:88, 52:88].mean() > 0.9
    assert ghost[:40].mean() < 1e-3


def test_nothing_is_told_by_one_exposure_or_without_noise() -> None:
    rng = np.random.default_rng(5)
    one = [expose(scene(0), 1.0, rng, None)]
    assert not without_ghosts(one).ghost.any()
    blind = [expose(scene(0), k, rng, None, noise=None) for k in SCALES]
    result = without_ghosts(blind)
    assert not result.ghost.any()
    assert result.reference is None


@PHASES
@pytest.mark.parametrize("step", [0.0, 1.0, 2.5])
def test_a_shaken_camera_is_told_how_far(cfa: Cfa | None, step: float) -> None:
    rng = np.random.default_rng(6)
    logs = np.log(scene(7))
    frames = []
    for index, k in enumerate(SCALES):
        motion = np.float32([[1, 0, step * index], [0, 1, -0.5 * step * index]])
        moved = cv2.warpAffine(
            logs, motion, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        frames.append(expose(np.exp(moved), k, rng, cfa))
    measured = shifts(frames[::-1])
    assert len(measured) >= 2
    # The shorter exposure is the later one: the longer lies to its left.
    for shift in measured:
        assert shift.x == pytest.approx(-step, abs=0.45)
        assert shift.y == pytest.approx(0.5 * step, abs=0.45)


def test_exposures_that_share_nothing_tell_no_shift() -> None:
    rng = np.random.default_rng(8)
    assert shifts([expose(scene(0), k, rng, None) for k in (1.0, 2.0**-20)]) == []
    assert shifts([expose(np.full(SIZE, 1e4), k, rng, None) for k in SCALES]) == []


@PHASES
@pytest.mark.parametrize("step", [0.0, 2.0])
def test_what_is_not_valid_moves_no_shift(cfa: Cfa | None, step: float) -> None:
    """A standing pattern behind a mask that stands still, in front of a picture that does not."""
    rng, hidden = np.random.default_rng(9), np.zeros(SIZE, bool)
    hidden[40:140, 80:200] = True
    frames = []
    for index, k in enumerate(SCALES):
        motion = np.float32([[1, 0, step * index], [0, 1, 0]])
        moved = cv2.warpAffine(
            np.log(scene(7)), motion, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        frame = expose(np.where(hidden, scene(10), np.exp(moved)), k, rng, cfa)
        frames.append(replace(frame, valid=~hidden))
    measured = shifts(frames)
    assert len(measured) >= 2
    for shift in measured:
        assert shift.x == pytest.approx(-step, abs=0.3)


@PHASES
def test_no_ghost_is_looked_for_where_masks_ask_not_to(cfa: Cfa | None) -> None:
    """Expect no ghost behind a mask, and no influence of its noise on the rest of the picture."""
    rng, hidden = np.random.default_rng(11), np.zeros(SIZE, bool)
    hidden[:120] = True
    frames = [expose(np.where(hidden, scene(20 + i), scene(0)), k, rng, cfa) for i, k in enumerate(SCALES)]
    moved = np.ones(SIZE)
    moved[140:170, 190:230] = 8.0
    frames[2] = expose(np.where(hidden, 1.0, scene(0) * moved), SCALES[2], rng, cfa)
    masked, blind = without_ghosts(frames, hidden=hidden), without_ghosts(frames)
    assert blind.ghost[:120].mean() > 0.1
    assert blind.noise > 2 * masked.noise
    assert not masked.ghost[:120].any()
    assert masked.noise < 1.2
    assert masked.ghost[145:165, 195:225].mean() > 0.5
    assert masked.ghost[:, :180].mean() < 0.01


@PHASES
def test_a_ghost_that_the_best_exposure_does_not_show_is_shown_by_another(cfa: Cfa | None) -> None:
    rng = np.random.default_rng(12)
    light, moved = np.full(SIZE, 0.2), np.full(SIZE, 0.2)
    moved[60:120, 60:120] = 0.05
    frames = [expose(moved if k < 1 else light, k, rng, cfa) for k in (1.0, 0.5, 0.25)]
    whole = without_ghosts(frames)
    assert whole.reference == 0
    gone = np.ones(SIZE, bool)
    gone[90:120, 90:120] = False
    # The last exposure sees a third scene, so that the hidden part is a ghost of the other two.
    frames[2] = expose(np.where(gone, moved, 0.4), 0.25, rng, cfa)
    result = without_ghosts([replace(frames[0], valid=gone), *frames[1:]])
    assert result.reference == 0
    part = np.s_[94:116, 94:116]
    assert result.ghost[part].all()
    assert np.isfinite(result.merged.radiance).all()
    np.testing.assert_array_equal(result.merged.radiance[part], frames[1].signal[part] / np.float32(0.5))
