"""Bands: their order, their channels in an EXR, their colours against CIE 1931 as colour-science has it."""

import numpy as np
import pytest
from pydantic import ValidationError

from imaging.session.bands import channels, false_colour, in_order, matching
from imaging.session.records import Band, SessionRecord


def bands(*waves: float) -> tuple[Band, ...]:
    return tuple(Band(name=f"{wave:g}nm", wavelength_nm=wave) for wave in waves)


def test_order_is_that_of_wavelengths_then_of_names() -> None:
    mixed = (Band(name="uv"), *bands(650, 450), Band(name="clear"))
    assert [band.name for band in in_order(mixed)] == ["450nm", "650nm", "clear", "uv"]


def test_channels_are_those_of_a_spectral_exr() -> None:
    named = (Band(name="a", wavelength_nm=650), Band(name="b", wavelength_nm=1050.5), Band(name="h-alpha"))
    assert channels(named) == ("S0.650,000000nm", "S0.1050,500000nm", "h-alpha")
    assert channels(()) == ("R", "G", "B")


def test_no_two_channels_have_one_name() -> None:
    """Polarisers divide the light of one wavelength, and A is the channel of alpha."""
    alike = (*bands(550), Band(name="par", wavelength_nm=650), Band(name="perp", wavelength_nm=650))
    assert channels((*alike, Band(name="A"))) == ("S0.550,000000nm", "par", "perp", "band:A")


def test_matching_functions_are_those_of_the_cie() -> None:
    colour = pytest.importorskip("colour")
    waves = np.arange(400.0, 701.0, 10.0)
    truth = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"][waves]
    assert np.abs(matching(waves) - truth).max() < 0.02


def test_a_flat_spectrum_is_white_and_a_narrow_one_has_its_hue() -> None:
    matrix = false_colour(bands(450, 500, 550, 600, 650))
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0)
    assert matrix[:, 0].argmax() == 2
    assert matrix[:, 2].argmax() == 1
    assert matrix[:, 4].argmax() == 0
    # Before white is made (1, 1, 1), the colour of 550 nm lies where the CIE has it.
    x, y, z = matching(np.array([550.0]))[0]
    assert (x / (x + y + z), y / (x + y + z)) == pytest.approx((0.302, 0.692), abs=0.01)


@pytest.mark.parametrize(
    "shown", [bands(850, 950, 1050, 1650), (Band(name="a"), Band(name="b"), Band(name="c"))]
)
def test_what_the_eye_does_not_see_gets_colours_in_its_order(shown: tuple[Band, ...]) -> None:
    matrix = false_colour(shown)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0)
    assert matrix[2].argmax() == 0
    assert matrix[0].argmax() == len(shown) - 1


@pytest.mark.parametrize("shown", [bands(550), bands(600, 650, 700), bands(450, 650)])
def test_too_few_colours_are_grey(shown: tuple[Band, ...]) -> None:
    matrix = false_colour(shown)
    assert matrix.shape == (3, len(shown))
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0)
    assert np.isfinite(matrix).all()


def test_a_session_has_each_band_once_and_at_most_sixteen() -> None:
    facts = {"name": "s", "created": "2026-01-01T00:00:00", "origin": "import", "cameras": ()}
    with pytest.raises(ValidationError, match="two bands have the same name"):
        SessionRecord(**facts, bands=bands(450, 450))
    with pytest.raises(ValidationError, match="17 bands, and a scene has at most 16"):
        SessionRecord(**facts, bands=bands(*range(400, 570, 10)))
