"""Colour matrices against the standards' printed numbers."""

import colour
import numpy as np
import pytest

from imaging.colour.spaces import (
    PRIMARIES,
    REC709_FROM_XYZ,
    XYZ_FROM_REC709,
    Space,
    adaptation,
    camera_from_rec709,
    rec709_from_rgb,
    space_from_rec709,
    srgb_decode,
    srgb_encode,
    xyz_from_rgb,
)


def test_rec709_as_printed_in_iec_61966() -> None:
    printed = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    assert np.abs(XYZ_FROM_REC709 - printed).max() < 1e-4
    assert np.allclose(REC709_FROM_XYZ @ XYZ_FROM_REC709, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "space"),
    [("rec709", "ITU-R BT.709"), ("rec2020", "ITU-R BT.2020"), ("ap0", "ACES2065-1"), ("ap1", "ACEScg")],
)
def test_primaries_as_colour_science_has_them(name: str, space: str) -> None:
    peer = colour.RGB_COLOURSPACES[space]
    assert np.allclose(PRIMARIES[name][:3], peer.primaries)
    assert np.allclose(PRIMARIES[name][3], peer.whitepoint)
    peer = colour.normalised_primary_matrix(peer.primaries, peer.whitepoint)
    assert np.allclose(xyz_from_rgb(PRIMARIES[name]), peer, atol=1e-12)


@pytest.mark.parametrize(("space", "name"), [("acescg", "ACEScg"), ("aces2065-1", "ACES2065-1")])
def test_aces_spaces_as_colour_science_has_them(space: Space, name: str) -> None:
    matrix = space_from_rec709(space)
    peer = colour.matrix_RGB_to_RGB("ITU-R BT.709", name, chromatic_adaptation_transform="Bradford")
    assert np.abs(matrix - peer).max() < 1e-6
    assert matrix @ np.ones(3) == pytest.approx(np.ones(3), abs=1e-12)


def test_files_of_plain_xyz_are_understood() -> None:
    equal = (1 / 3, 1 / 3)
    matrix = rec709_from_rgb([(1.0, 0.0), (0.0, 1.0), (0.0, 0.0), equal])
    assert matrix == pytest.approx(REC709_FROM_XYZ @ adaptation(equal, (0.3127, 0.3290)), abs=1e-12)


def test_rec709_stays_what_it_is() -> None:
    assert np.array_equal(space_from_rec709("rec709"), np.eye(3))


def test_adaptation_as_colour_science_has_it() -> None:
    d50, d65 = (0.3457, 0.3585), (0.3127, 0.3290)
    whites = [colour.xy_to_XYZ(white) for white in (d50, d65)]
    peer = colour.adaptation.matrix_chromatic_adaptation_VonKries(*whites, transform="Bradford")
    assert np.abs(adaptation(d50, d65) - peer).max() < 1e-12
    assert adaptation(d50, d65) @ whites[0] == pytest.approx(whites[1])


def test_the_green_row_of_the_camera_sums_to_one() -> None:
    camera_from_xyz = np.array([[0.9, -0.3, -0.1], [-0.4, 1.2, 0.2], [0.0, 0.2, 0.6]])
    matrix = camera_from_rec709(camera_from_xyz)
    assert matrix[1].sum() == pytest.approx(1.0)
    assert np.allclose(camera_from_rec709(7 * camera_from_xyz), matrix)
    white = camera_from_xyz @ XYZ_FROM_REC709 @ np.ones(3)
    assert np.allclose(matrix @ np.ones(3), white / white[1])


def test_a_camera_that_is_an_ideal_observer_of_rec709() -> None:
    assert np.allclose(camera_from_rec709(REC709_FROM_XYZ), np.eye(3), atol=1e-12)


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.ones((3, 3)), -np.eye(3)])
def test_a_matrix_that_cannot_be_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(ValueError, match="singular"):
        camera_from_rec709(matrix)


def test_the_srgb_curve() -> None:
    assert srgb_encode([0.0, 0.0031308, 0.18, 1.0]) == pytest.approx([0.0, 0.04045, 0.46136, 1.0], abs=1e-5)
    codes = np.linspace(0, 1, 1001)
    assert np.allclose(srgb_encode(srgb_decode(codes)), codes, atol=1e-7)
    assert srgb_encode([-1.0, 2.0]) == pytest.approx([0.0, 1.0])
    assert srgb_decode(np.float32([0.5])).dtype == np.float32
    assert srgb_encode(np.array([1], np.uint8)) == pytest.approx([1.0])
