"""Corners against the board that was rendered; boards of other prints, and boards that are none."""

import numpy as np
import pytest

from calib.boards.corners import FEWEST, PRINTS, Print, find, find_all
from imaging.arrays import Bytes
from imaging.errors import CalibrationError
from imaging.progress import unreported
from imaging.session.records import Board
from tests.calib.boards.conftest import Stage


def picture(stage: Stage, camera: int, frame: int) -> Bytes:
    """Picture of a camera, with noise of two codes."""
    rendered = stage.shown.render(
        stage.rig.mounts[camera].optics.lens, stage.cam_from_board(camera, frame), samples=2
    )
    noise = np.random.default_rng(frame).normal(0.0, 2.0, rendered.shape)
    return np.clip(200.0 * rendered + noise, 0, 255).astype(np.uint8)


def test_corners_lie_where_the_simulator_has_them(stage: Stage) -> None:
    misses = []
    for frame in range(3):
        corners = find(stage.board, picture(stage, 1, frame), Print())
        assert len(corners.ids) >= 8
        misses.append(corners.points - stage.corners(1, frame)[corners.ids])
    every = np.concatenate(misses)
    assert np.median(np.linalg.norm(every, axis=1)) < 0.08
    assert np.abs(every.mean(0)).max() < 0.02  # half a pixel would show


@pytest.mark.parametrize("blur", [0.0, 1.0])
def test_corners_of_a_small_blurred_board_lie_where_they_are(blur: float) -> None:
    """Squares of 25 px whose white rim is 3 px wide: a blur fills the window that a corner is sought in."""
    import cv2

    board = Board(columns=7, rows=5, square=0.04, marker=0.03)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    flat = np.asarray(cv2.aruco.CharucoBoard((7, 5), 0.04, 0.03, dictionary).generateImage((1120, 800)))
    flat = np.pad(flat, 160, constant_values=255).astype(np.float32) * 0.8 + 20
    turn = np.array([[0.15, 0.04, 10.0], [-0.03, 0.155, 40.0], [-2e-5, 3e-5, 1.0]])
    half = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])  # OpenCV counts from centres
    wide = np.linalg.inv(half) @ np.diag([4.0, 4.0, 1.0]) @ turn @ half  # four times the size, then averaged
    drawn = cv2.warpPerspective(flat, wide, (960, 800), flags=cv2.INTER_AREA, borderValue=100)
    image = cv2.resize(drawn, (240, 200), interpolation=cv2.INTER_AREA)
    if blur:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    image = image + np.random.default_rng(0).normal(0.0, 1.0, image.shape)
    corners = find(board, np.clip(image, 0, 255).astype(np.uint8), Print())
    assert len(corners.ids) >= 16
    places = board.corners()[:, :2] / 0.04 * 160 + 160
    at = np.column_stack([places, np.ones(len(places))]) @ turn.T
    misses = np.linalg.norm(corners.points - (at[:, :2] / at[:, 2:])[corners.ids], axis=1)
    assert np.sqrt((misses**2).mean()) < 0.04


@pytest.mark.parametrize("printed", PRINTS, ids=str)
def test_any_print_of_the_board_is_recognised(printed: Print) -> None:
    """Only an even number of rows differs between the patterns before and after OpenCV 4.6."""
    import cv2

    board = Board(columns=7, rows=6, square=0.03, marker=0.022)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    layout = cv2.aruco.CharucoBoard((7, 6), 0.03, 0.022, dictionary)
    layout.setLegacyPattern(printed.legacy)
    image = np.pad(np.asarray(layout.generateImage((700, 600))), 40, constant_values=255)
    image = 255 - image if printed.inverted else image
    by_view, recognised = find_all(board, [("a", 0)], lambda key: np.asarray(image, np.uint8), unreported)
    assert recognised == printed
    corners = by_view["a", 0]
    assert corners.ids.tolist() == list(range(30))
    expected = board.corners()[:, :2] / 0.03 * 100 + 40
    np.testing.assert_allclose(corners.points, expected, atol=0.1)


def test_swapped_columns_and_rows_are_named() -> None:
    stage_board = Board(columns=7, rows=5, square=0.03, marker=0.022)
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    image = cv2.aruco.CharucoBoard((7, 5), 0.03, 0.022, dictionary).generateImage((700, 500))
    wrong = stage_board.model_copy(update={"columns": 5, "rows": 7})
    padded = np.pad(np.asarray(image, np.uint8), 40, constant_values=255)
    with pytest.raises(CalibrationError, match="swap columns and rows"):
        find_all(wrong, [("a", 0)], lambda key: padded, unreported)


def flat_board(columns: int, rows: int) -> Bytes:
    """A board of squares of 100 px on white, with a rim of 40 px."""
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    layout = cv2.aruco.CharucoBoard((columns, rows), 0.03, 0.022, dictionary)
    image = layout.generateImage((100 * columns, 100 * rows))
    return np.pad(np.asarray(image, np.uint8), 40, constant_values=255)


@pytest.mark.parametrize("columns", [1, 2])
def test_two_columns_of_corners_are_enough_and_one_is_not(columns: int) -> None:
    """Half of the corners lie in one line, in a board that the edge of the picture cuts."""
    import cv2

    board = Board(columns=7, rows=5, square=0.03, marker=0.022)
    turn = np.array([[0.8, 0.1, 40.0], [-0.03, 0.75, 60.0], [1e-4, -5e-5, 1.0]])
    pixels = flat_board(7, 5)
    pixels[:, 40 + 100 * (columns + 1) :] = 150
    drawn = cv2.warpPerspective(pixels, turn, (780, 580), borderValue=150)
    noise = np.random.default_rng(0).normal(0.0, 2.0, drawn.shape)
    corners = find(board, np.clip(drawn + noise, 0, 255).astype(np.uint8), Print())
    assert len(corners.ids) == (4 * columns if columns > 1 else 0)
    flat = board.corners()[corners.ids, :2] / 0.03 * 100 + 39.5  # OpenCV counts from centres
    at = np.column_stack([flat, np.ones(len(flat))]) @ turn.T
    np.testing.assert_allclose(corners.points, at[:, :2] / at[:, 2:] + 0.5, atol=0.15)


def test_pictures_that_show_too_little_of_the_board_are_refused() -> None:
    board = Board(columns=7, rows=5, square=0.03, marker=0.022)
    pixels = np.full((580, 780), 150, np.uint8)
    pixels[:340, :340] = flat_board(7, 5)[:340, :340]  # four inner corners
    assert 0 < len(find(board, pixels, Print()).ids) < FEWEST
    with pytest.raises(CalibrationError, match=r"6 corners of the board or more: show it larger and whole"):
        find_all(board, [("a", 0)], lambda key: pixels, unreported)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_pictures_without_a_board_are_refused(level: int) -> None:
    board = Board(columns=7, rows=5, square=0.03, marker=0.022)
    blank = np.full((240, 320), level, np.uint8)
    with pytest.raises(CalibrationError, match="correct its description, or show it larger"):
        find_all(board, [("a", 0), ("b", 0)], lambda key: blank, unreported)


@pytest.mark.parametrize(
    "wrong",
    [
        {"columns": 2},
        {"square": 0.0},
        {"marker": 0.2},
        {"dictionary": "DICT_NONE"},
        {"columns": 30, "rows": 30},
        {"square": float("nan")},
    ],
)
def test_boards_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"board|smaller|dictionary|greater|finite"):
        Board.model_validate({"columns": 7, "rows": 5, "square": 0.1, "marker": 0.08} | wrong)
