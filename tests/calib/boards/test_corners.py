"""Corners against the board that was rendered; boards of other prints, and boards that are none."""

import numpy as np
import pytest

from calib.boards.corners import PRINTS, Picture, Print, find, find_all
from imaging.errors import CalibrationError
from imaging.records import Board
from tests.calib.boards.conftest import Stage


def silent(message: str, done: int, total: int) -> None:
    pass


def picture(stage: Stage, camera: int, frame: int) -> Picture:
    """What a camera sees, with noise of two codes."""
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
    found, recognised = find_all(board, [("a", 0)], lambda key: np.asarray(image, np.uint8), silent)
    assert recognised == printed
    corners = found["a", 0]
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
        find_all(wrong, [("a", 0)], lambda key: padded, silent)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_pictures_without_a_board_are_refused(level: int) -> None:
    board = Board(columns=7, rows=5, square=0.03, marker=0.022)
    blank = np.full((240, 320), level, np.uint8)
    with pytest.raises(CalibrationError, match="correct its description, or show it larger"):
        find_all(board, [("a", 0), ("b", 0)], lambda key: blank, silent)


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
