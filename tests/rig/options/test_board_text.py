"""A board described in one word, and words that describe none."""

import pytest
import typer

import calib.boards.measure
import capture.rigfile.template
import drivers.sim.scene.board
from imaging.errors import InputError
from imaging.session.records import Board
from rig.options.board_text import EXAMPLE, board_text


def test_the_example_everywhere_is_the_board_that_simulated_cameras_see() -> None:
    """Let users who copy it while trying things out get a scene of the right scale."""
    shown = Board.model_validate(drivers.sim.scene.board.SimulatedBoard().description())
    assert board_text(EXAMPLE).board() == shown
    assert shown == capture.rigfile.template.EXAMPLE
    assert calib.boards.measure.EXAMPLE == EXAMPLE


def test_order_units_and_case_do_not_matter() -> None:
    board = board_text("dict_5x5_100, marker=2.2cm ,square=0.03m,12x9").board()
    assert board.dictionary == "DICT_5X5_100"
    assert (board.columns, board.rows) == (12, 9)
    assert board.marker == pytest.approx(0.022)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("7x5", "square: field required"),
        ("7x5,square=110mm,marker=120mm", "a marker has to be smaller"),
        ("7x5,square=110,marker=82.5", "'square=110' does not describe a board"),
        ("7x5,square=110mm,marker=82.5mm,DICT_9X9", "has no dictionary"),
        ("70x50,square=11mm,marker=8mm", "1750 markers"),
        ("2x5,square=11mm,marker=8mm", "greater than or equal to 3"),
        ("3x3,square=11mm,marker=8mm", "6 inner corners or more"),
        ("7x5,square=0mm,marker=0mm", "greater than 0"),
        ("a board", "'a board' does not describe a board"),
    ],
)
def test_words_that_describe_no_board_say_so_in_one_sentence(text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        board_text(text).board()
    assert message in str(error.value)
    assert EXAMPLE in str(error.value)
    assert "\n" not in str(error.value)


def test_nothing_is_refused_as_usage() -> None:
    with pytest.raises(typer.BadParameter, match="describe the board"):
        board_text("  ")
