"""Parts of a plan: every session in one of them, and their results joined as if one had made all."""

from dataclasses import replace
from pathlib import Path

import pytest

from imaging.errors import InputError
from rig.batch.batch_plan import BatchPlan, PlannedScene
from rig.batch.result import BatchResult, BatchRow
from rig.batch.shards import merged, shard_of

SCENES = (PlannedScene(name="one"), PlannedScene(name="two"))


@pytest.fixture
def plan(tmp_path: Path) -> BatchPlan:
    return BatchPlan(tmp_path / "PLAN.toml", tuple(tmp_path / f"s{number}" for number in range(7)), SCENES)


def written(part: BatchPlan, db: float = 30.0) -> BatchResult:
    """Result of a part in which everything was made."""
    rows = [
        BatchRow(session=one, scene=scene.called, words=" ".join(scene.words()), db=db)
        for one in part.sessions
        for scene in part.scenes
    ]
    result = BatchResult(plan=part.path, rows=tuple(rows), shard=part.shard)
    result.write()
    return result


@pytest.mark.parametrize("count", [1, 3, 7, 9])
def test_every_session_is_in_one_part_and_the_parts_join_in_order(plan: BatchPlan, count: int) -> None:
    parts = [shard_of(plan, f"{number + 1}/{count}") for number in range(count)]
    assert sorted(session for part in parts for session in part.sessions) == sorted(plan.sessions)
    sizes = [len(part.sessions) for part in parts]
    assert max(sizes) - min(sizes) <= 1
    for part in reversed(parts):
        written(part)
    result, missing = merged(plan)
    assert missing is None
    assert [(row.session, row.scene) for row in result.rows] == [
        (session, scene.called) for session in plan.sessions for scene in SCENES
    ]


def test_the_newest_row_counts_and_what_no_part_made_is_named(plan: BatchPlan) -> None:
    written(shard_of(plan, "1/2"), db=20.0)
    written(shard_of(plan, "1/3"), db=31.0)
    result, missing = merged(plan)
    db = {row.session.name: row.db for row in result.rows}
    assert db == {"s0": 31.0, "s2": 20.0, "s3": 31.0, "s4": 20.0, "s6": 31.0}
    assert missing is not None
    assert missing.startswith("4 of 14 scenes have no result, such as one of ")
    assert "s1" in missing


def test_no_row_is_that_of_another_plan_or_of_what_a_scene_was(plan: BatchPlan) -> None:
    plans = [replace(plan, path=plan.path.with_name(name)) for name in ("P.toml", "P.v2.toml", "P[1].toml")]
    for number, one in enumerate(plans):
        written(shard_of(one, "1/1"), db=float(number))
    assert [{row.db for row in merged(one)[0].rows} for one in plans] == [{0.0}, {1.0}, {2.0}]
    changed = replace(plans[0], scenes=(SCENES[0], PlannedScene(name="two", quality="best")))
    result, missing = merged(changed)
    assert [row.scene for row in result.rows] == ["one"] * 7
    assert missing is not None
    assert missing.startswith("7 of 14 scenes have no result, such as two of ")


def test_paths_of_a_part_do_not_depend_on_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    relative = BatchPlan(Path("PLAN.toml"), (Path("s0"), Path("s1")), SCENES)
    written(shard_of(relative, "1/1"))
    monkeypatch.chdir("/")
    whole = BatchPlan(tmp_path / "PLAN.toml", (tmp_path / "s0", tmp_path / "s1"), SCENES)
    assert merged(whole)[1] is None


@pytest.mark.parametrize("text", ["0/4", "5/4", "1", "a/b", "-1/2", "1/0", "1/2/3", "", "²/3"])
def test_a_part_that_is_none_is_refused(plan: BatchPlan, text: str) -> None:
    with pytest.raises(InputError, match="such as 3/8"):
        shard_of(plan, text)


def test_nothing_to_join_and_a_damaged_record_are_one_sentence(plan: BatchPlan) -> None:
    with pytest.raises(InputError, match="no shard has written a result"):
        merged(plan)
    (plan.path.parent / "PLAN.1-of-2.batch.json").write_text('{"plan": 3}')
    with pytest.raises(InputError, match="is damaged: run its shard again"):
        merged(plan)
