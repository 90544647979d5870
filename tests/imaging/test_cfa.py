"""Bayer phases, crops, and bilinear demosaicing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging.cfa import Cfa, bilinear, mosaic

all_phases = pytest.mark.parametrize("cfa", list(Cfa))


def test_the_phases_as_they_are_read() -> None:
    assert Cfa.RGGB.pattern.tolist() == [[0, 1], [1, 2]]
    assert Cfa.BGGR.pattern.tolist() == [[2, 1], [1, 0]]
    assert Cfa.GRBG.pattern.tolist() == [[1, 0], [2, 1]]
    assert Cfa.GBRG.pattern.tolist() == [[1, 2], [0, 1]]


@all_phases
def test_a_phase_from_its_pattern(cfa: Cfa) -> None:
    assert Cfa.from_pattern(cfa.pattern) is cfa
    assert Cfa.from_pattern(cfa.pattern.tolist()) is cfa


@pytest.mark.parametrize("pattern", [[[0, 1], [2, 1]], [[1, 1], [1, 1]], [[0, 1, 1]], np.zeros((6, 6), int)])
def test_other_patterns_are_refused(pattern: object) -> None:
    with pytest.raises(ValueError, match="Cfa"):
        Cfa.from_pattern(pattern)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.sampled_from(list(Cfa)),
    st.integers(0, 5),
    st.integers(0, 5),
    st.integers(1, 7),
    st.integers(1, 7),
)
def test_a_crop_shifts_the_phase(cfa: Cfa, top: int, left: int, height: int, width: int) -> None:
    whole = cfa.channels(12, 12)
    cropped = cfa.cropped(top, left).channels(height, width)
    assert np.array_equal(cropped, whole[top : top + height, left : left + width])


@all_phases
def test_a_mosaic_keeps_the_channel_of_each_site(cfa: Cfa) -> None:
    rgb = np.random.default_rng(1).random((5, 7, 3))
    seen = mosaic(rgb, cfa)
    for row in range(5):
        for column in range(7):
            assert seen[row, column] == rgb[row, column, "RGB".index(cfa[2 * (row % 2) + column % 2])]


@all_phases
@pytest.mark.parametrize(("height", "width"), [(2, 2), (3, 3), (8, 9), (11, 6)])
def test_a_constant_image_is_exact(cfa: Cfa, height: int, width: int) -> None:
    rgb = np.broadcast_to(np.array([0.25, 0.5, 3.0]), (height, width, 3))
    seen, known = bilinear(mosaic(rgb, cfa), cfa)
    assert seen.dtype == np.float32
    assert known.all()
    assert np.array_equal(seen, rgb.astype(np.float32))


@all_phases
def test_a_ramp_is_exact_inside(cfa: Cfa) -> None:
    rows, columns = np.mgrid[0:12, 0:14].astype(np.float64)
    rgb = np.stack([rows + 2 * columns, 3 * rows - columns + 50, 5 + rows], axis=-1)
    seen, _ = bilinear(mosaic(rgb, cfa), cfa)
    assert np.allclose(seen[1:-1, 1:-1], rgb[1:-1, 1:-1], atol=1e-5)


@all_phases
def test_own_samples_are_kept(cfa: Cfa) -> None:
    rgb = np.random.default_rng(2).random((9, 10, 3)).astype(np.float32)
    seen, _ = bilinear(mosaic(rgb, cfa), cfa)
    assert np.array_equal(mosaic(seen, cfa), mosaic(rgb, cfa))


@all_phases
@pytest.mark.parametrize("bad", [(4, 5), (5, 4), (4, 4), (5, 5)])
@pytest.mark.parametrize("value", [1e6, np.nan, np.inf])
def test_a_saturated_photosite_does_not_spread(cfa: Cfa, bad: tuple[int, int], value: float) -> None:
    rgb = np.broadcast_to(np.array([0.25, 0.5, 3.0]), (10, 11, 3))
    image = mosaic(rgb, cfa).copy()
    valid = np.ones(image.shape, bool)
    image[bad], valid[bad] = value, False
    seen, known = bilinear(image, cfa, valid)
    expected, filled = rgb.astype(np.float32), np.ones(rgb.shape, bool)
    own = cfa.channels(10, 11)[bad]
    if own != 1:  # red and blue have no second photosite within reach, green has four
        expected[(*bad, own)], filled[(*bad, own)] = 0.0, False
    assert np.array_equal(known, filled)
    assert np.array_equal(seen, expected)


@all_phases
def test_where_nothing_is_known_it_says_so(cfa: Cfa) -> None:
    image = np.ones((10, 10), np.float32)
    valid = np.ones((10, 10), bool)
    valid[2:8, 2:8] = False
    seen, known = bilinear(image, cfa, valid)
    assert not known[4:6, 4:6].any()
    assert np.all(seen[~known] == 0)
    assert np.all(seen[known] == 1)
    assert not bilinear(image, cfa, np.zeros((10, 10), bool))[1].any()
