"""Light on a screen: what the tones of the viewer say of it."""

import numpy as np
import pytest

from imaging.colour.spaces import srgb_decode, srgb_encode
from recon.result import display
from recon.result.first_look import shot_at
from rig.view.pictures import look, tones
from rig.view.pictures.look import (
    STOPS,
    TONE_MAPS,
    Look,
    band_legend,
    bands,
    coloured,
    first_look,
    legend,
    stops,
)


def flat(*colours: tuple[float, float, float]) -> np.ndarray:
    return np.array([colours], np.float32)


def test_middle_grey_is_where_the_maps_have_it() -> None:
    """sRGB of 0.18 is 118 of 255 (IEC 61966-2-1); ACES 2.0 shows it at 0.349, 10 nits of 100."""
    grey = flat((0.18,) * 3)
    assert Look().shown(grey, 1.0).tolist() == [[[118] * 3]]
    assert Look(tones="ACES 2.0").shown(grey, 1.0).tolist() == [[[89] * 3]]
    middle = band_legend()[0, 8 * 16 + 8]
    np.testing.assert_array_equal(Look(tones="false colour").shown(grey, 1.0)[0, 0], middle)


@pytest.mark.parametrize("tones", TONE_MAPS)
def test_a_stop_is_a_factor_of_two(tones: str) -> None:
    light = np.random.default_rng(3).lognormal(-2, 2, (8, 9, 3)).astype(np.float32)
    once = Look(-2.0, tones).shown(light, 3.0)
    np.testing.assert_array_equal(once, Look(0.0, tones).shown(light, 0.75))
    np.testing.assert_array_equal(once, Look(0.0, tones).shown(light * np.float32(0.25), 3.0))
    assert once.dtype == np.uint8
    assert once.shape == light.shape


@pytest.mark.parametrize("tones", ["linear", "ACES 2.0", "AgX", "filmic"])
def test_more_light_is_never_darker(tones: str) -> None:
    ramp = np.repeat(np.exp2(np.linspace(-20, 20, 400)).astype(np.float32)[None, :, None], 3, axis=2)
    shown = Look(tones=tones).shown(ramp, 1.0).astype(int)
    assert (np.diff(shown, axis=1) >= 0).all()
    assert (shown[0, 0] == 0).all()
    assert (shown[0, -1] >= 248).all()


@pytest.mark.parametrize("tones", TONE_MAPS)
def test_no_light_and_too_much_of_it_are_shown(tones: str) -> None:
    light = flat((0, 0, 0), (1e30, 1e30, 1e30), (-1, -1, -1), (np.inf, 1, 1), (np.nan, 1, 1))
    with np.errstate(all="raise"):
        shown = Look(12.0, tones).shown(light, 1e3)
    assert shown.shape == (1, 5, 3)
    if tones != "clipping":
        assert shown[0, 0].tolist() == [0, 0, 0]


def test_stops_are_those_of_luminance() -> None:
    light = flat((0.18, 0.18, 0.18), (0.36, 0.36, 0.36), (0, 0.18, 0), (0, 0, 0))
    np.testing.assert_allclose(stops(light, 1.0)[0], [0, 1, np.log2(0.7152), -np.inf], atol=1e-5)
    ends = coloured(np.array([[-STOPS - 3, STOPS + 3]], np.float32))[0]
    np.testing.assert_array_equal(ends, legend()[0, [0, -1]])
    assert ends[0, 2] > ends[0, 0]
    assert ends[1, 0] > ends[1, 2]


def test_false_colour_has_a_colour_for_each_stop_and_its_legend_says_which() -> None:
    values = np.array([[-9.0, -8.0, -0.4, 0.0, 0.4, 0.6, 1.4, 8.0, 30.0, -np.inf]], np.float32)
    shown = bands(values)[0]
    picture = band_legend()
    assert picture.shape == (26, 272, 3)
    for value, colour in zip([-8, -8, 0, 0, 0, 1, 1, 8, 8], shown, strict=False):
        np.testing.assert_array_equal(colour, picture[5, 16 * (value + 8) + 8])
    assert not shown[-1].any()
    assert len({tuple(colour) for colour in picture[5]}) == 17
    # numbers stand below every fourth
    written = picture[14:].max(axis=(0, 2)) > 60
    centres = [16 * (value + 8) + 8 for value in (-8, -4, 0, 4, 8)]
    assert all(written[max(0, place - 9) : place + 9].any() for place in centres)
    assert not any(written[place - 4 : place + 4].any() for place in (40, 104, 168, 232))


def test_clipping_is_told_by_channel() -> None:
    light = flat((0.2, 0.2, 0.2), (0.2, 1.5, 0.2), (1e-5, 1e-5, 1e-5))
    grey, bright, dark = Look(tones="clipping").shown(light, 1.0)[0].astype(int)
    assert np.ptp(grey) == 0
    assert bright[0] == 255
    assert bright[1] < 50
    assert dark[2] == 255
    assert dark[0] < 50


def test_linear_is_what_pictures_on_disk_are() -> None:
    light = np.exp2(np.random.default_rng(5).uniform(-14, 1, (60, 70, 3))).astype(np.float32)
    far = np.abs(tones.linear(light).astype(int) - display.displayed(light, 1.0))
    assert far.max() <= 1
    assert (far > 0).mean() < 0.02
    assert look.MIDDLE_GREY == display.MIDDLE_GREY


def test_agx_is_the_curve_of_its_author() -> None:
    """Sobotka's own is closed: two hyperbolas that meet at middle grey, over log2 of 16.5 stops.

    Greys pass its matrices unchanged.
    """
    grey = np.exp2(np.linspace(-11, 3.5, 60)) * 0.18
    pivot, middle, slope = 10 / 16.5, 0.5, 2.0
    place = (np.log2(grey / 0.18) + 10) / 16.5

    def scale(x: float, y: float, power: float) -> float:
        return ((slope * x) ** -power * ((slope * x / y) ** power - 1)) ** (-1 / power)

    power = np.where(place < pivot, 3.0, 3.25)
    reach = np.where(place < pivot, -scale(pivot, middle, 3.0), scale(1 - pivot, 1 - middle, 3.25))
    term = slope * (place - pivot) / reach
    with np.errstate(invalid="ignore"):
        curve = np.clip(reach * term / (1 + term**power) ** (1 / power) + middle, 0, 1)
    shown = tones.agx(np.repeat(grey[None, :, None], 3, axis=2).astype(np.float32))[0]
    assert np.ptp(shown, axis=1).max() <= 1
    np.testing.assert_allclose(shown[:, 1], 255 * srgb_encode(curve**2.2), atol=3)


def test_filmic_is_hables_curve() -> None:
    """Compare with his article: ((x(Ax+CB)+DE)/(x(Ax+B)+DF))-E/F of twice the light, over that of 11.2."""
    light = np.linspace(0, 6, 50)

    def curve(x: float | np.ndarray) -> float | np.ndarray:
        return (x * (0.22 * x + 0.03) + 0.002) / (x * (0.22 * x + 0.3) + 0.06) - 0.01 / 0.3

    shown = tones.filmic(np.repeat(light[None, :, None], 3, axis=2).astype(np.float32))[0, :, 0]
    expected = np.minimum(curve(2 * light) / curve(11.2), 1)
    np.testing.assert_allclose(srgb_decode(shown / 255), expected, atol=0.006)


def test_what_a_camera_developed_is_shown_at_first_as_it_was_shot_and_all_else_by_agx() -> None:
    jpeg = [[("raw/0000/a_0.jpg", 0.02)], [("raw/0001/a_0.jpg", 0.01)], [("raw/0002/a_0.jpg", 0.02)]]
    look = first_look(0.005, shot_at(jpeg))
    assert look == Look(2.0, "linear")
    # Light of 50 had the code of white in two of the three photographs.
    assert look.shown(np.full((1, 1, 3), 49.9, np.float32), 0.005).tolist() == [[[255] * 3]]
    assert look.shown(np.full((1, 1, 3), 25.0, np.float32), 0.005).tolist() == [[[188] * 3]]
    for other in ([], [[("a.dng", 0.02)]], [[("a.exr", 1.0)]], [[("a.jpg", 0.02), ("b.jpg", 0.04)]], [[]]):
        assert first_look(0.005, shot_at(other)) == Look(0.0, "AgX")
