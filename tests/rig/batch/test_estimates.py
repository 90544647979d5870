"""Estimates of a plan: grow with the work, leave out what is there, and hold against what was measured."""

import shutil
from pathlib import Path

import pytest

from rig.batch.batch_plan import BatchPlan, PlannedScene
from rig.batch.estimates import Estimate, estimates

SMALL = {"gaussians": 300, "iterations": 30, "width": 64}


def of(session: Path, *scenes: PlannedScene) -> list[Estimate]:
    return list(estimates(BatchPlan(session.parent / "PLAN.toml", (session,), scenes)))


@pytest.fixture
def fresh(toy: Path) -> Path:
    """The toy without its calibration."""
    shutil.rmtree(toy / "calibration")
    return toy


def test_the_calibration_counts_once_and_only_until_it_is_there(toy: Path) -> None:
    scenes = PlannedScene(name="a", set=SMALL), PlannedScene(name="b", set=SMALL)
    there = of(toy, *scenes)
    shutil.rmtree(toy / "calibration")
    first, second = of(toy, *scenes)
    assert there[0].processor_seconds == there[1].processor_seconds == second.processor_seconds
    assert first.processor_seconds > second.processor_seconds
    assert first.more > second.more


def test_larger_trainings_cost_more(toy: Path) -> None:
    rows = of(
        toy,
        PlannedScene(name="small", set=SMALL),
        PlannedScene(name="longer", set=SMALL | {"iterations": 3000}),
        PlannedScene(name="larger", set=SMALL | {"gaussians": 100_000}),
    )
    small, longer, larger = rows
    assert longer.processor_seconds > small.processor_seconds + 10
    assert (longer.more, larger.more - small.more) == (small.more, 400 * 99_700)


def test_a_scene_that_is_there_costs_nothing(toy: Path) -> None:
    (toy / "reconstructions" / "small").mkdir(parents=True)
    (toy / "reconstructions" / "small" / "model.json").touch()
    (row,) = of(toy, PlannedScene(name="small"))
    assert (row.processor_seconds, row.more) == (0.0, 0)


def test_the_scene_of_another_method_is_not_the_one_that_is_there(toy: Path) -> None:
    (toy / "reconstructions" / "hdr-gs-standard").mkdir(parents=True)
    (toy / "reconstructions" / "hdr-gs-standard" / "model.json").touch()
    methods = ("nh-3dgs", "hdr-gs", "vanilla", "auto")
    rows = of(toy, *(PlannedScene(method=method) for method in methods))
    assert [row.processor_seconds > 0 for row in rows] == [True, False, True, False]


def test_a_castle_is_calibrated_in_what_it_was_measured_to_take(fresh: Path) -> None:
    """README.md: eleven photographs of 6 megapixels, 73 s of processor time."""
    lines = (fresh / "shots.jsonl").read_text().splitlines()
    chosen = [line for line in lines if "_0." in line][:6]
    assert len(chosen) == 6
    big = [
        line.replace('"width": 64', '"width": 2832').replace('"height": 48', '"height": 2128')
        for line in chosen
    ]
    (fresh / "shots.jsonl").write_text("\n".join(big) + "\n")
    before = of(fresh, PlannedScene(name="a", set=SMALL))[0].processor_seconds
    (fresh / "calibration").mkdir()
    (fresh / "calibration" / "calibration.json").touch()
    after = of(fresh, PlannedScene(name="a", set=SMALL))[0].processor_seconds
    assert before - after == pytest.approx(73 * 6 / 11, rel=0.1)


def test_a_damaged_session_is_named(fresh: Path) -> None:
    (fresh / "session.json").write_text("{")
    (row,) = of(fresh, PlannedScene())
    assert str(fresh) in row.says
    assert row.processor_seconds == 0
