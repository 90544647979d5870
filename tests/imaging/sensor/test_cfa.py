"""Bayer phases, crops, and bilinear demosaicing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging.sensor.cfa import BAYER, Cfa, bilinear, cell_means, mosaic

all_phases = pytest.mark.parametrize("cfa", BAYER)
OTHERS = (Cfa.X_TRANS, Cfa.QUAD_BAYER, Cfa.KODAK_RGBW, Cfa.MONO, Cfa.of("RG/BG"))
other_tables = pytest.mark.parametrize("cfa", OTHERS)
all_tables = pytest.mark.parametrize("cfa", [*BAYER, *OTHERS])


def test_the_phases_as_they_are_read() -> None:
    assert Cfa.RGGB.pattern.tolist() == [[0, 1], [1, 2]]
    assert Cfa.BGGR.pattern.tolist() == [[2, 1], [1, 0]]
    assert Cfa.GRBG.pattern.tolist() == [[1, 0], [2, 1]]
    assert Cfa.GBRG.pattern.tolist() == [[1, 2], [0, 1]]


@all_phases
def test_a_phase_from_its_pattern(cfa: Cfa) -> None:
    assert Cfa.from_pattern(cfa.pattern) == cfa
    assert Cfa.from_pattern(cfa.pattern.tolist()) == cfa


@pytest.mark.parametrize(
    "pattern", [[[1, 1], [1, 1]], [[0, 1, 1]], np.zeros((6, 6), int), [[0, 1, 2, 3]], [[-1]]]
)
def test_other_patterns_are_refused(pattern: object) -> None:
    with pytest.raises(ValueError, match="Cfa"):
        Cfa.from_pattern(pattern)


@pytest.mark.parametrize("text", ["", "RG/G", "CM/YG", "RW/WB", "RGGB/"])
def test_what_is_no_table_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="no Cfa: rows of equal length hold R, G and B"):
        Cfa.of(text)


@all_tables
def test_a_table_is_its_text_and_its_pattern_however_often_repeated(cfa: Cfa) -> None:
    assert Cfa.of(str(cfa)) == cfa
    assert len({cfa, Cfa.of(str(cfa))}) == 1
    assert Cfa.from_pattern(np.tile(cfa.pattern, (2, 3)), cfa.letters) == cfa


def test_channels_count_in_the_order_of_the_letters() -> None:
    assert (Cfa.KODAK_RGBW.letters, Cfa.KODAK_RGBW.pattern[0].tolist()) == ("RGBW", [3, 2, 3, 1])
    assert (Cfa.MONO.letters, Cfa.MONO.pattern.tolist(), Cfa.MONO.tile) == ("W", [[0]], (2, 2))
    counts = [
        np.bincount(cfa.pattern.ravel()).tolist() for cfa in (Cfa.X_TRANS, Cfa.QUAD_BAYER, Cfa.KODAK_RGBW)
    ]
    assert counts == [[8, 20, 8], [4, 8, 4], [2, 4, 2, 8]]


@all_tables
def test_every_cell_has_every_colour_and_no_smaller_one_that_the_table_is_made_of_has(cfa: Cfa) -> None:
    channels = cfa.channels(24, 24)

    def whole(side: int) -> bool:
        cells = (channels[y : y + side, x : x + side] for y in range(0, 24, side) for x in range(0, 24, side))
        return all(len(np.unique(cell)) == len(cfa.letters) for cell in cells)

    assert whole(cfa.cell)
    assert not any(cfa.tile[0] % side == 0 and whole(side) for side in range(2, cfa.cell))


@all_tables
def test_cells_are_means_of_their_own_channel(cfa: Cfa) -> None:
    image = np.random.default_rng(3).random((25, 38))
    means, channels, side = cell_means(image, cfa), cfa.channels(25, 38), cfa.cell
    assert means.shape == (25 // side, 38 // side, len(cfa.letters))
    for row, column, channel in np.ndindex(means.shape):
        cut = np.s_[side * row : side * (row + 1), side * column : side * (column + 1)]
        assert means[row, column, channel] == pytest.approx(
            image[cut][channels[cut] == channel].mean(), rel=1e-5
        )


@other_tables
def test_a_constant_image_of_any_table_is_exact(cfa: Cfa) -> None:
    light = np.broadcast_to(np.array([0.25, 0.5, 3.0, 7.0])[: len(cfa.letters)], (13, 17, len(cfa.letters)))
    valid = np.random.default_rng(4).random((13, 17)) > 0.05
    image = np.where(valid, mosaic(light, cfa), 1e6)
    filled_in, known = bilinear(image, cfa, valid)
    assert np.all(filled_in[known] == light.astype(np.float32)[known])
    assert known.mean() > 0.9


@settings(max_examples=100)
@given(
    st.sampled_from([*BAYER, *OTHERS]),
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
    sites = mosaic(rgb, cfa)
    for row in range(5):
        for column in range(7):
            assert sites[row, column] == rgb[row, column, "RGB".index(cfa.rows[row % 2][column % 2])]


@all_phases
@pytest.mark.parametrize(("height", "width"), [(2, 2), (3, 3), (8, 9), (11, 6)])
def test_a_constant_image_is_exact(cfa: Cfa, height: int, width: int) -> None:
    rgb = np.broadcast_to(np.array([0.25, 0.5, 3.0]), (height, width, 3))
    filled_in, known = bilinear(mosaic(rgb, cfa), cfa)
    assert filled_in.dtype == np.float32
    assert known.all()
    assert np.array_equal(filled_in, rgb.astype(np.float32))


@all_phases
def test_a_ramp_is_exact_inside(cfa: Cfa) -> None:
    rows, columns = np.mgrid[0:12, 0:14].astype(np.float64)
    rgb = np.stack([rows + 2 * columns, 3 * rows - columns + 50, 5 + rows], axis=-1)
    filled_in, _ = bilinear(mosaic(rgb, cfa), cfa)
    assert np.allclose(filled_in[1:-1, 1:-1], rgb[1:-1, 1:-1], atol=1e-5)


@all_phases
def test_own_samples_are_kept(cfa: Cfa) -> None:
    rgb = np.random.default_rng(2).random((9, 10, 3)).astype(np.float32)
    filled_in, _ = bilinear(mosaic(rgb, cfa), cfa)
    assert np.array_equal(mosaic(filled_in, cfa), mosaic(rgb, cfa))


@all_phases
@pytest.mark.parametrize("bad", [(4, 5), (5, 4), (4, 4), (5, 5)])
@pytest.mark.parametrize("value", [1e6, np.nan, np.inf])
def test_a_saturated_photosite_does_not_spread(cfa: Cfa, bad: tuple[int, int], value: float) -> None:
    rgb = np.broadcast_to(np.array([0.25, 0.5, 3.0]), (10, 11, 3))
    image = mosaic(rgb, cfa).copy()
    valid = np.ones(image.shape, bool)
    image[bad], valid[bad] = value, False
    filled_in, known = bilinear(image, cfa, valid)
    expected, filled = rgb.astype(np.float32), np.ones(rgb.shape, bool)
    channel = cfa.channels(10, 11)[bad]
    if channel != 1:  # red and blue have no second photosite within reach, green has four
        expected[(*bad, channel)], filled[(*bad, channel)] = 0.0, False
    assert np.array_equal(known, filled)
    assert np.array_equal(filled_in, expected)


@all_phases
def test_where_nothing_is_known_it_says_so(cfa: Cfa) -> None:
    image = np.ones((10, 10), np.float32)
    valid = np.ones((10, 10), bool)
    valid[2:8, 2:8] = False
    filled_in, known = bilinear(image, cfa, valid)
    assert not known[4:6, 4:6].any()
    assert np.all(filled_in[~known] == 0)
    assert np.all(filled_in[known] == 1)
    assert not bilinear(image, cfa, np.zeros((10, 10), bool))[1].any()
