"""Markers in pictures: their middles where perspective truly puts them."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.boards.measure import picture_of
from calib.data.views import scene_views
from calib.survey.marks import detect, find_markers, numbers_of
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from tests.calib.conftest import make_session

DICTIONARY = "DICT_APRILTAG_36h11"


def sheet(numbers: list[int], quads: np.ndarray, size: tuple[int, int] = (640, 480)) -> np.ndarray:
    """A grey picture with markers whose outer corners are at `quads` [N, 4, 2], pixel centres at +0.5."""
    scale, side = 4, 80
    width, height = size
    picture = np.full((height * scale, width * scale), 170, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    for number, quad in zip(numbers, quads, strict=True):
        marker = np.pad(cv2.aruco.generateImageMarker(dictionary, number, side), 10, constant_values=255)
        square = np.array([[10, 10], [90, 10], [90, 90], [10, 90]], np.float32) - 0.5
        to = cv2.getPerspectiveTransform(square, (scale * quad - 0.5).astype(np.float32))
        shape = picture.shape[1], picture.shape[0]
        drawn = cv2.warpPerspective(marker, to, shape, flags=cv2.INTER_LINEAR)
        there = cv2.warpPerspective(np.full_like(marker, 255), to, shape, flags=cv2.INTER_NEAREST)
        picture = np.where(there > 0, drawn, picture)
    return cv2.GaussianBlur(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), (0, 0), 0.6)


def middle(quad: np.ndarray) -> np.ndarray:
    """Middle of a square under a homography."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    to = cv2.getPerspectiveTransform(square, quad.astype(np.float32))
    return cv2.perspectiveTransform(np.array([[[0.5, 0.5]]], np.float64), to)[0, 0]


def test_the_middle_is_where_perspective_has_it() -> None:
    rng = np.random.default_rng(3)
    quads = []
    for place in ((90, 100), (280, 90), (480, 120), (120, 330), (330, 320), (520, 340)):
        square = np.array([[-40, -40], [40, -40], [40, 40], [-40, 40]], float)
        quads.append(square * rng.uniform(0.7, 1.2, (4, 1)) + place + rng.uniform(0, 1, 2))
    middles = detect(DICTIONARY, sheet([3, 5, 7, 11, 13, 17], np.array(quads)))
    assert sorted(middles) == [3, 5, 7, 11, 13, 17]
    off = [
        np.linalg.norm(middles[number] - middle(quad))
        for number, quad in zip(sorted(middles), quads, strict=True)
    ]
    assert max(off) < 0.2
    assert any(np.linalg.norm(quad.mean(0) - middle(quad)) > 1 for quad in quads)  # which the mean is not


def test_a_marker_that_is_there_twice_tells_nothing() -> None:
    square = np.array([[-40, -40], [40, -40], [40, 40], [-40, 40]], float)
    quads = square + np.array([[[100, 100]], [[300, 100]], [[500, 300]]])
    assert sorted(detect(DICTIONARY, sheet([3, 3, 4], quads))) == [4]
    assert detect(DICTIONARY, np.full((100, 100), 128, np.uint8)) == {}


def test_markers_are_found_in_the_views_of_a_session(tmp_path: Path) -> None:
    """And only those that the survey has; in px of the file."""
    square = np.array([[-40, -40], [40, -40], [40, 40], [-40, 40]], float)
    places = np.array([[100.3, 100.2], [300.7, 120.4], [500.1, 300.9]])
    quads = square + places[:, None]
    pictures = [sheet([3, 4, 5], quads), sheet([4, 5, 6], quads)]
    folder = make_session(
        tmp_path / "session",
        [[(np.repeat(one[..., None], 3, axis=2), Exposure(time=0.1))] for one in pictures],
    )
    session = Session.open(folder)
    marks = find_markers(
        DICTIONARY, ["tag 3", "4", "corner"], scene_views(session), partial(picture_of, session), unreported
    )
    assert {name: sorted(by_view) for name, by_view in marks.items()} == {
        "tag 3": [ViewId(0, "cam")],
        "4": [ViewId(0, "cam"), ViewId(1, "cam")],
    }
    assert np.linalg.norm(np.array(marks["4"][ViewId(0, "cam")].at) - places[1]) < 0.2
    assert np.linalg.norm(np.array(marks["4"][ViewId(1, "cam")].at) - places[0]) < 0.2
    assert marks["4"][ViewId(0, "cam")].detected


@pytest.mark.parametrize("name", ["7", "07", "marker 7", "target_7", "Tag7", "ID 7"])
def test_points_are_called_by_the_numbers_of_markers(name: str) -> None:
    assert numbers_of([name, "A1", "corner"]) == {7: name}
