"""Where a training is on its schedule, with turns and without."""

import pytest

from recon.train.densification import Density, DensityRules
from recon.train.schedule import Course


def test_as_planned_every_iteration_is_one_step():
    course = Course.straight(300)
    assert [course.position(i) for i in range(301)] == list(range(301))
    assert [course.progress(i) for i in range(301)] == [i / 300 for i in range(301)]  # to the last bit
    assert course.total == 300


def test_a_turn_brings_the_rest_into_as_many_iterations_as_asked():
    course = Course.straight(100).turned(40, 10)
    assert course.total == 50
    assert course.position(40) == 40
    assert course.position(45) == pytest.approx(70)
    assert course.position(50) == course.position(51) == 100
    longer = course.turned(45, 20).turned(55, 1)
    assert longer.total == 56
    assert longer.position(45) == pytest.approx(70)
    assert longer.position(55) == pytest.approx(85)
    assert longer.progress(56) == 1


def test_a_second_turn_at_once_replaces_the_first():
    course = Course.straight(100).turned(40, 10).turned(40, 20)
    assert course == Course.straight(100).turned(40, 20)


def test_written_down_and_read_again_it_is_the_same():
    course = Course.straight(100).turned(33, 7).turned(35, 3)
    assert Course.of([list(turn) for turn in course.turns]) == course


def test_growth_keeps_its_times_on_the_schedule():
    """However fast the training goes through it, as many adaptations come, unless two fall into one step."""
    density = Density(DensityRules(100, begin=0.1, end=0.5, every=0.1), None)
    for course in (Course.straight(100), Course.straight(100).turned(12, 22)):
        steps = [(course.position(i), course.position(i + 1)) for i in range(course.total)]
        assert sum(density.due(after, 100, after - before) for before, after in steps) == 5
    fast = Course.straight(100).turned(12, 2)
    steps = [(fast.position(i), fast.position(i + 1)) for i in range(fast.total)]
    assert sum(density.due(after, 100, after - before) for before, after in steps) <= 3
