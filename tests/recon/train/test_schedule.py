"""Position of a training on its schedule, with turns and without."""

from itertools import pairwise

import pytest

from recon.train.densification import Density, DensityRules
from recon.train.schedule import Schedule


def test_as_planned_every_iteration_is_one_step():
    schedule = Schedule.straight(300)
    assert [schedule.position(i) for i in range(301)] == list(range(301))
    assert [schedule.progress(i) for i in range(301)] == [i / 300 for i in range(301)]  # to the last bit
    assert schedule.total == 300


def test_a_turn_brings_the_rest_into_as_many_iterations_as_asked():
    schedule = Schedule.straight(100).turned(40, 10)
    assert schedule.total == 50
    assert schedule.position(40) == 40
    assert schedule.position(45) == pytest.approx(70)
    assert schedule.position(50) == schedule.position(51) == 100
    longer = schedule.turned(45, 20).turned(55, 1)
    assert longer.total == 56
    assert longer.position(45) == pytest.approx(70)
    assert longer.position(55) == pytest.approx(85)
    assert longer.progress(56) == 1


def test_a_second_turn_at_once_replaces_the_first():
    schedule = Schedule.straight(100).turned(40, 10).turned(40, 20)
    assert schedule == Schedule.straight(100).turned(40, 20)


def test_written_down_and_read_again_it_is_the_same():
    schedule = Schedule.straight(100).turned(33, 7).turned(35, 3)
    assert Schedule.of([list(turn) for turn in schedule.turns]) == schedule


def test_growth_keeps_its_times_on_the_schedule():
    """However fast the training goes through it, as many adaptations come, unless two fall into one step."""
    density = Density(DensityRules(100, begin=0.1, end=0.5, every=0.1), None)
    for schedule in (Schedule.straight(100), Schedule.straight(100).turned(12, 22)):
        steps = [(schedule.position(i), schedule.position(i + 1)) for i in range(schedule.total)]
        assert sum(density.due(after, 100, after - before) for before, after in steps) == 5
    fast = Schedule.straight(100).turned(12, 2)
    steps = [(fast.position(i), fast.position(i + 1)) for i in range(fast.total)]
    assert sum(density.due(after, 100, after - before) for before, after in steps) <= 3


def test_iterations_that_stand_still_have_everything_on_and_split_nothing():
    schedule = Schedule.still(5, 0.7)
    assert (schedule.planned, schedule.total) == (5, 5)
    assert [schedule.progress(i) for i in range(6)] == pytest.approx([0.7] * 6)
    rules = Density(DensityRules(100, begin=0.0, end=1.0), None)
    places = [schedule.position(i) for i in range(6)]
    assert not any(rules.due(after, 5, after - before) for before, after in pairwise(places))
