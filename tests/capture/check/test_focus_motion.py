"""Sharpness, shifts and what moved, on simulated frames whose blur and motion are known."""

import numpy as np
import pytest

from capture.check import focus, motion
from capture.pictures import reduced_pictures
from capture.pictures.reduced_pictures import ReducedPicture
from imaging.optics.exposure import Exposure

from .brackets import blurred, photo, scene, seen_raw, shifted

LONG, SHORT = Exposure(time=1 / 4), Exposure(time=1 / 32)


def picture(light, exposure=LONG, seed=0, kind="raw") -> ReducedPicture:
    if kind == "raw":
        return seen_raw(light, exposure, seed)
    return reduced_pictures.of_photo(photo(light, exposure, seed).astype(np.float32) / 255)


def sharpness(light, exposure=LONG, kind="raw") -> float | None:
    return focus.sharpness(focus.detail(picture(light, exposure, kind=kind)))


@pytest.mark.parametrize("kind", ["raw", "ldr"])
def test_sharpness_falls_with_blur_and_not_with_the_scene_or_its_contrast(kind):
    values = [sharpness(scene(seed), kind=kind) for seed in range(4)]
    assert max(values) < 1.3 * min(values)
    softer = [sharpness(blurred(scene(0), sigma), kind=kind) for sigma in (0.5, 1.0, 2.0, 4.0)]
    assert all(a > b for a, b in zip([values[0], *softer], softer, strict=False))
    assert softer[2] < 0.4 * values[0]
    assert sharpness(scene(0) ** 0.3, kind=kind) == pytest.approx(values[0], rel=0.25)


def test_noise_is_no_detail():
    sharp, dim = sharpness(blurred(scene(1), 3.0)), sharpness(blurred(scene(1), 3.0), SHORT)
    assert dim < 0.4 * sharpness(scene(1))
    assert dim == pytest.approx(sharp, abs=0.1)


def test_a_wall_and_a_clipped_picture_say_nothing_of_focus():
    assert sharpness(np.full((96, 96, 3), 1.0)) is None
    assert sharpness(scene(0), Exposure(time=1000.0)) is None
    assert sharpness(scene(0), Exposure(time=1e-5)) is None


def test_one_blurred_exposure_is_told_from_the_rest_of_its_bracket():
    exposures = [Exposure(time=time) for time in (1 / 2, 1 / 4, 1 / 8)]
    details = [
        focus.detail(picture(blurred(scene(2), 2.0) if index == 1 else scene(2), one, index))
        for index, one in enumerate(exposures)
    ]
    ratios = [focus.against(one, [o for o in details if o is not one]) for one in details]
    assert ratios[1] < 0.4
    assert min(ratios[0], ratios[2]) > 0.9


@pytest.mark.parametrize("kind", ["raw", "ldr"])
@pytest.mark.parametrize("shift", [(1, 0), (0, -1), (3, 2), (-9, 6)])
def test_a_shift_is_measured(kind, shift):
    light = scene(3)
    measured = motion.compare(picture(light, LONG, 0, kind), picture(shifted(light, *shift), SHORT, 1, kind))
    assert measured.shift == pytest.approx(shift, abs=0.1)
    assert measured.length > 5 * measured.error


@pytest.mark.parametrize("kind", ["raw", "ldr"])
@pytest.mark.parametrize("seed", range(5))
def test_what_stands_still_does_not_move(kind, seed):
    light = scene(seed)
    measured = motion.compare(picture(light, LONG, 0, kind), picture(light, SHORT, 1, kind))
    assert measured.length < 0.1
    assert measured.moved == 0.0


@pytest.mark.parametrize("kind", ["raw", "ldr"])
def test_an_object_of_two_percent_that_moved_is_found(kind):
    still = scene(4)
    height, width = still.shape[:2]
    high, wide = round(height * 0.14), round(width * 0.14)
    first, second = still.copy(), still.copy()
    first[40 : 40 + high, 30 : 30 + wide] = 1.2
    second[40 : 40 + high, 150 : 150 + wide] = 1.2
    measured = motion.compare(picture(first, LONG, 0, kind), picture(second, SHORT, 1, kind))
    assert 0.01 < measured.moved < 0.08
    assert measured.length < 0.1


def test_pictures_of_two_scenes_have_moved_almost_everywhere():
    measured = motion.compare(picture(scene(5)), picture(scene(6), SHORT))
    assert measured is None or measured.moved > 0.3


def test_exposures_that_share_nothing_are_not_compared():
    assert motion.compare(picture(scene(0), Exposure(time=1000.0)), picture(scene(0))) is None
    assert motion.compare(picture(scene(0)), picture(scene(0), Exposure(time=1e-5))) is None
    assert motion.compare(picture(scene(0)), picture(scene(0, 80, 120))) is None
    assert motion.compare(picture(scene(0, 16, 16)), picture(scene(0, 16, 16))) is None
