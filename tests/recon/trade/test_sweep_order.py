"""Trainings of a trade-off, and the front, against brute force."""

from dataclasses import replace

import numpy as np
import pytest

from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES
from recon.trade.point import behind, front
from recon.trade.sweep_order import STANDARD, Session, expected_seconds, neighbours, planned
from recon.trade.trade_record import Choice, Point

RICH = Session(width=1280, views=40, exposures=5)


def point(choice: Choice, db: float = 30.0, seconds: float = 10.0) -> Point:
    effective = RICH.effective(choice)
    return Point(
        key="k", choice=choice, command="", iterations=1, gaussians=effective.gaussians,
        degree=2 if effective.degree is None else effective.degree, width=64, device="", seconds=seconds,
        processor_seconds=1.0, at_once=1, size_bytes=1, splats_sha256="", db=db, views={},
    )  # fmt: skip


def test_the_front_is_what_nothing_beats() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        points = [tuple(pair) for pair in rng.integers(0, 8, (30, 2)).tolist()]
        front_of = front(points, lambda p: p[0], lambda p: p[1])
        unbeaten = {
            (x, y) for x, y in points if not any((a <= x and b >= y) and (a, b) != (x, y) for a, b in points)
        }
        assert set(front_of) == unbeaten
        assert front_of == sorted(front_of)
        for p in points:
            short = behind(points, lambda q: q[0], lambda q: q[1], p)
            assert short == max(b for a, b in points if a <= p[0]) - p[1]
            assert short == 0 or p not in unbeaten


def test_presets_and_single_changes_are_planned_once_each() -> None:
    choices = planned(RICH, None)
    assert [choice.quality for choice in choices[:3]] == ["standard", "draft", "best"]
    changed = {key for choice in choices for key in choice.overrides.model_dump(exclude_none=True)}
    assert changed == {
        "iterations", "gaussians", "width", "degree", "ssim", "growth", "views", "exposures"
    }  # fmt: skip
    assert all(len(choice.overrides.words()) == (choice.axis != "preset") for choice in choices)
    trained = [RICH.effective(choice) for choice in choices]
    assert len(set(trained)) == len(trained)


@pytest.mark.parametrize("refine", [None, "poses+exposures"])
def test_single_changes_keep_what_the_scene_decided(refine: str | None) -> None:
    update = {"gaussians": 9000, "degree": 0, "refine": refine}
    standard = point(STANDARD).model_copy(update=update)
    singles = [choice for choice in planned(RICH, standard) if choice.axis != "preset"]
    base = RICH.trained(standard).model_dump()
    for choice in singles:
        overrides = RICH.effective(choice).model_dump()
        assert len([key for key in base if overrides[key] != base[key]]) == 1, choice
    counts = {choice.overrides.gaussians for choice in singles if choice.axis == "Gaussians"}
    assert counts == {2250, 4500, 18_000}
    assert {choice.overrides.degree for choice in singles if choice.axis == "SH degree"} == {1, 2}
    without = [choice.overrides.refine for choice in singles if choice.axis == "corrections"]
    assert without == (["none"] if refine else [])


@pytest.mark.parametrize("views", [3, 5, 40])
@pytest.mark.parametrize("exposures", [1, 2, 7])
@pytest.mark.parametrize("width", [16, 60, 4000])
def test_nothing_is_planned_that_a_session_does_not_have(views: int, exposures: int, width: int) -> None:
    session = Session(width=width, views=views, exposures=exposures)
    for choice in planned(session, None):
        overrides = session.effective(choice)
        assert 16 <= overrides.width <= width
        assert overrides.exposures is None or 1 <= overrides.exposures < exposures
        assert overrides.views is None or 3 <= overrides.views <= views


def test_neighbours_are_new_and_no_more_work_than_what_was_done() -> None:
    done = [point(choice, db=30 + n, seconds=10 + n) for n, choice in enumerate(planned(RICH, None))]
    known = {RICH.trained(one) for one in done}
    choices = list(neighbours(done, RICH))
    assert choices
    assert not known & {RICH.effective(choice) for choice in choices}
    most = max(RICH.work(one.choice) for one in done)
    assert all(RICH.work(choice) <= most for choice in choices)
    assert [RICH.work(choice) for choice in choices] == sorted(RICH.work(choice) for choice in choices)
    assert list(neighbours([], RICH)) == []


def test_work_grows_with_all_that_takes_time() -> None:
    usual = RICH.work(Choice(axis=""))
    for more in ({"iterations": 4000}, {"gaussians": 80_000}, {"width": 1280}):
        assert RICH.work(Choice(axis="", overrides=Overrides(**more))) > usual
    assert RICH.work(Choice(axis="", overrides=Overrides(exposures=1))) < usual


def iterations(count: int, seconds: float = 0.0) -> Point:
    return point(Choice(axis="", overrides=Overrides(iterations=count)), seconds=seconds)


def test_expected_seconds_lie_on_the_line_through_the_nearest_two() -> None:
    wanted = iterations(1000).choice
    assert expected_seconds(wanted, [], RICH) is None
    assert expected_seconds(wanted, [iterations(2000, 100)], RICH) == pytest.approx(1.2 * 50)
    # 20 s to begin with, 0.04 s an iteration.
    done = [iterations(2000, 100), iterations(500, 40), iterations(100_000, 1.0)]
    assert expected_seconds(wanted, done, RICH) == pytest.approx(1.2 * 60)
    # Less work that took longer tells nothing of what more of it costs.
    assert expected_seconds(wanted, [iterations(900, 50), iterations(800, 70)], RICH) == 1.2 * 50


def test_a_scene_that_needed_few_gaussians_is_expected_to_need_no_more() -> None:
    best = Choice(axis="preset", quality="best")
    full = [point(Choice(axis="preset", quality="draft"), seconds=10), point(STANDARD, seconds=60)]
    count = QUALITIES["standard"].gaussians // 8
    few = [full[0], full[1].model_copy(update={"gaussians": count})]
    # As long as a training would that has just so many.
    seconds = expected_seconds(best, few, RICH)
    overrides = expected_seconds(
        Choice(axis="", quality="best", overrides=Overrides(gaussians=count)), few, RICH
    )
    assert seconds == overrides
    # More than the preset allows it never is.
    draft = Choice(axis="preset", quality="draft")
    many = [full[1].model_copy(update={"gaussians": QUALITIES["standard"].gaussians - 1})]
    most = draft.model_copy(update={"overrides": Overrides(gaussians=QUALITIES["draft"].gaussians)})
    assert expected_seconds(draft, many, RICH) == expected_seconds(most, many, RICH)


def test_a_small_picture_is_no_narrower_than_it_is() -> None:
    small = replace(RICH, width=64)
    assert small.effective(Choice(axis="")).width == 64
    assert small.effective(Choice(axis="", quality="best")).width == 64
