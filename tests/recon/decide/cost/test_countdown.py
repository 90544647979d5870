"""A budget of time counts from Enter to the end; what does not fit is left out and said, or refused."""

import pytest

from imaging.errors import InputError
from recon.decide.cost.budget import Budget
from recon.decide.cost.countdown import MOST_OF_START, PAGE, SAVING, Countdown
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct


class Clock:
    """Stands still until it is told."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def counting(seconds: float, spent: float = 0.0, page: bool = True) -> tuple[Countdown, Clock, list[str]]:
    """A countdown of which `spent` seconds are over, its clock and what it says."""
    clock, said = Clock(), list[str]()
    return Countdown(seconds, clock.now - spent, page, clock, said.append), clock, said


def test_what_went_by_before_the_work_counts() -> None:
    countdown, clock, _ = counting(60, spent=5)
    assert countdown.remaining() == 55
    clock.now += 10
    assert countdown.remaining() == 45


def test_time_is_kept_for_files_and_page() -> None:
    countdown, _, said = counting(60)
    countdown.plan(look=2.0, train=20, held_out=4)
    assert countdown.page
    assert countdown.remaining() == pytest.approx(60 - SAVING * 2 - PAGE * 2 * 4 / 20)
    assert said == []


def test_a_page_that_takes_too_much_is_left_out_and_said() -> None:
    countdown, _, said = counting(20, spent=8)
    countdown.plan(look=2.0, train=20, held_out=4)
    assert not countdown.page
    assert countdown.remaining() == pytest.approx(12 - SAVING * 2)
    assert said == ["20 s leave no room for evaluation and page: `rig evaluate` makes them."]


def test_the_start_has_its_share_and_no_more() -> None:
    countdown, clock, _ = counting(60)
    over = countdown.start_over()
    clock.now += MOST_OF_START * 60 - 0.1
    assert not over()
    clock.now += 0.2
    assert over()


def test_a_time_that_cannot_do_is_refused_with_one_that_would() -> None:
    countdown, _, _ = counting(20, spent=14)
    countdown.require(6.0, 50)
    with pytest.raises(InputError, match=r"^20 s are too short .* give --budget 25s or more\.$"):
        countdown.require(9.0, 50)


def test_no_scene_of_three_iterations_is_made_in_silence(session_copy, monkeypatch) -> None:
    """Let every reading of the clock take a second, so that twenty have no room for fifty iterations."""
    monkeypatch.setitem(QUALITIES, "draft", Quality(1000, 400, 64))
    clock = Clock()

    def slow() -> float:
        clock.now += 1.0
        return clock.now

    with pytest.raises(InputError, match="fewest iterations, 50"):
        reconstruct(session_copy, TrainingRequest(quality="draft", budget=Budget(20.0, "s")), clock=slow)
    assert not list(session_copy.glob("reconstructions/*/*"))


def test_depths_of_some_views_are_left_out_and_said(session_copy, monkeypatch) -> None:
    monkeypatch.setitem(QUALITIES, "draft", Quality(5, 1200, 64))
    monkeypatch.setattr(Countdown, "start_over", lambda self: lambda: True)
    said: list[str] = []
    reconstruct(
        session_copy, TrainingRequest(quality="draft", budget=Budget(600.0, "s")), on_message=said.append
    )
    assert "600 s leave no room for the depths of 5 of 5 views." in said
