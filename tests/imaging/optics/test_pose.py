"""Up in the world, by how photographers hold cameras: level, or on their side."""

import numpy as np
import pytest

from imaging.optics.pose import as_held, on_their_side, upright, upwards

RING = np.arange(0, 360, 30)
UP = np.array([0.0, 0.0, 1.0])


def view(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Camera from world, z up; roll in degrees, clockwise as the camera looks."""
    yaw, pitch, roll = np.radians([yaw, pitch, roll])
    ahead = np.array([np.cos(pitch) * np.sin(yaw), np.cos(pitch) * np.cos(yaw), np.sin(pitch)])
    level = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    below = np.cross(ahead, level)
    motion = np.eye(4)
    right = np.cos(roll) * level + np.sin(roll) * below
    motion[:3, :3] = np.stack([right, np.cross(ahead, right), ahead])
    return motion


@pytest.mark.parametrize("roll", [0, -90, 90], ids=["level", "grip up", "grip down"])
@pytest.mark.parametrize("pitches", [(0,), (5,), (-30, 30), (-30, 0, 30), (60,)])
def test_a_ring_of_views_has_its_axis_up_however_the_camera_is_held(
    pitches: tuple[float, ...], roll: float
) -> None:
    motions = [view(yaw, pitch, roll) for pitch in pitches for yaw in RING]
    up = upwards(motions)
    assert on_their_side(motions) == (roll != 0)
    np.testing.assert_allclose(up if roll != 90 else -up, UP, atol=1e-3)


@pytest.mark.parametrize(("orientation", "roll"), [(1, 0), (3, 180), (6, 90), (8, -90)])
def test_the_orientation_of_the_file_says_which_side_of_a_picture_is_up(
    orientation: int, roll: float
) -> None:
    for yaws in (RING, RING[:3], RING[:1]):
        upright = [as_held(view(yaw, 0, roll), orientation) for yaw in yaws]
        assert not on_their_side(upright)
        np.testing.assert_allclose(upwards(upright), UP, atol=1e-3)
        np.testing.assert_allclose(upright[0], view(yaws[0], 0, 0), atol=1e-12)


@pytest.mark.parametrize(
    "angles",
    [
        [(0, pitch, 0) for pitch in range(-90, 91, 30)],  # up and down from one heading
        [(yaw, -75, 0) for yaw in RING],  # an orbit from far above
        [(yaw, -65, 0) for yaw in (0, 180)] * 6,  # the lines of a drone, to and fro
        [(yaw, 65, 0) for yaw in (0, 180)],
        [(yaw, pitch, 0) for yaw in (0, 180) for pitch in (-90, -80, -70, -60, -50)],  # an arc overhead
    ],
    ids=["tilted", "steep", "to and fro", "two opposite", "arc"],
)
def test_a_level_camera_that_tilts_is_not_on_its_side(angles: list[tuple[float, float, float]]) -> None:
    motions = [view(*one) for one in angles]
    assert not on_their_side(motions)
    np.testing.assert_allclose(upwards(motions), UP, atol=1e-3)


def test_one_view_that_stands_wrong_does_not_count() -> None:
    level = [view(yaw, -65, 0) for yaw in (0, 180)] * 6
    aside = [view(yaw, -20, 90) for yaw in RING]
    for wrong in (view(0, 0, 180), view(0, -65, 130), view(0, -65, 230)):
        assert not on_their_side([*level, wrong])
        assert on_their_side([*aside, wrong])


ROWS = {1: "ab cd", 2: "ba dc", 3: "dc ba", 4: "cd ab", 5: "ac bd", 6: "bd ac", 7: "db ca", 8: "ca db"}
"""The picture "ab cd" as files of each orientation store it, by EXIF 2.32, 4.6.4."""


@pytest.mark.parametrize("orientation", ROWS)
def test_pictures_of_all_orientations_are_turned_upright_and_read_from_the_left(orientation: int) -> None:
    stored = np.array([list(row) for row in ROWS[orientation].split()])
    assert upright(stored, orientation).tolist() == [["a", "b"], ["c", "d"]]
