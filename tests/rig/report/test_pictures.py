"""Pictures for the page: exposures, error colours, data URIs that decode to what was put in."""

import base64

import cv2
import numpy as np
import pytest

from rig.report.charts.pictures import (
    MAP_COLOURS,
    UNKNOWN_GREY,
    developed,
    error_map,
    fitted,
    jpeg_uri,
    png_uri,
    three_exposures,
)
from rig.report.sections.comparisons import _map, _photo
from rig.report.sections.shots import compressed


def ramp(stops: float = 14.0) -> np.ndarray:
    """Grey light over many stops, [40, 60, 3]."""
    light = 2.0 ** np.linspace(0, stops, 60)
    return np.repeat(np.broadcast_to(light, (40, 60))[..., None], 3, axis=-1)


def decoded(uri: str) -> np.ndarray:
    data = np.frombuffer(base64.b64decode(uri.split(",", 1)[1]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]


def test_developing_follows_srgb() -> None:
    light = np.array([[[0.18] * 3, [0.09] * 3, [2.0] * 3, [-1.0] * 3, [np.nan] * 3]])
    np.testing.assert_array_equal(developed(light, 0.0)[0, :, 0], [118, 85, 255, 0, 0])
    np.testing.assert_array_equal(developed(light, 1.0)[0, 1], [118, 118, 118])


def test_three_exposures_show_highlights_middle_and_shadows() -> None:
    low, middle, high = three_exposures(ramp())
    assert low <= middle - 2
    assert high >= middle + 2
    assert np.median(developed(ramp(), middle)) == pytest.approx(118, abs=12)
    assert (developed(ramp(), low) < 255).mean() > 0.97


def test_three_exposures_of_darkness_do_not_fail() -> None:
    assert len(three_exposures(np.zeros((4, 4, 3)))) == 3


def test_the_error_map_is_dark_without_error_and_bright_with_two_stops() -> None:
    truth = np.ones((2, 3, 3))
    prediction = truth.copy()
    prediction[0] *= 4.0
    prediction[1, 0] /= 2.0
    colours = error_map(prediction, truth)
    np.testing.assert_array_equal(colours[1, 1], MAP_COLOURS[0])
    np.testing.assert_array_equal(colours[0, 0], MAP_COLOURS[-1])
    half = np.mean([MAP_COLOURS[2], MAP_COLOURS[3]], axis=0)
    np.testing.assert_allclose(colours[1, 0], half, atol=1)


def test_the_error_map_is_grey_where_nothing_is_known() -> None:
    truth = np.ones((1, 3, 3))
    truth[0, 0], truth[0, 1] = np.nan, 0.0
    assert (error_map(np.ones((1, 3, 3)), truth)[0, :2] == UNKNOWN_GREY).all()


def test_a_black_render_is_the_worst_error_not_an_unknown_one() -> None:
    colours = error_map(np.zeros((1, 1, 3)), np.ones((1, 1, 3)))
    np.testing.assert_array_equal(colours[0, 0], MAP_COLOURS[-1])


def test_compression_keeps_the_order_of_light_and_shows_both_ends() -> None:
    shown = compressed(ramp())[0, :, 0].astype(int)
    assert (np.diff(shown) >= 0).all()
    assert len(set(shown)) > 40
    assert shown[-1] > 200


def test_data_uris_hold_the_picture() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (9, 11, 3), dtype=np.uint8)
    assert png_uri(pixels).startswith("data:image/png;base64,")
    np.testing.assert_array_equal(decoded(png_uri(pixels)), pixels)
    smooth = developed(ramp(), -10.0)
    assert jpeg_uri(smooth).startswith("data:image/jpeg;base64,")
    assert np.abs(decoded(jpeg_uri(smooth)).astype(int) - smooth).mean() < 2


def test_fitting_keeps_the_shape_and_never_enlarges() -> None:
    assert fitted(np.zeros((300, 600, 3), np.uint8), 200).shape == (100, 200, 3)
    assert fitted(np.zeros((30, 60, 3), np.uint8), 200).shape == (30, 60, 3)


CORNERS = {1: (0, 0), 2: (0, -1), 3: (-1, -1), 4: (-1, 0), 5: (0, 0), 6: (0, -1), 7: (-1, -1), 8: (-1, 0)}


@pytest.mark.parametrize(("orientation", "corner"), CORNERS.items())
def test_compared_pictures_are_upright(orientation: int, corner: tuple[int, int]) -> None:
    """The upper left of what is stored comes to where EXIF has it."""
    stored = np.zeros((40, 60, 3), np.uint8)
    stored[:10, :10] = 255
    assert decoded(_photo(stored, "a picture", orientation).uri)[corner].min() > 200
    assert decoded(_map(stored, "a map", orientation).uri)[corner].min() == 255
