"""`rig batch` as people use it: a scene that is made, one that cannot be, a cluster that is not there."""

import json
import os
import shutil
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest

from imaging.session.session import SESSION
from rig.batch import command_processes, run
from rig.batch.batch_plan import BatchPlan
from rig.batch.result import BatchResult, BatchRow


@pytest.fixture(autouse=True)
def _this_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of the batch import this very code."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[3]), *sys.path]))
    monkeypatch.delenv("RAY_ADDRESS", raising=False)


def test_a_scene_is_made_and_what_fails_is_told(rig, toy: Path) -> None:
    plan = toy.parent / "PLAN.toml"
    plan.write_text(
        'sessions = ["toy"]\n[[scene]]\nname = "small"\nexport = ["scene.ply"]\n'
        'set = { iterations = 20, gaussians = 300, refine = "none", environment = false }\n'
        '[[scene]]\nmethod = "hdr-gs"\n'
    )
    code, out, err = rig("batch", str(plan), "--dry-run", "--json")
    assert code == 0, err
    estimate = json.loads(out)["estimates"][0]
    assert not (toy / "reconstructions").exists()
    before = sum(path.stat().st_size for path in toy.rglob("*") if path.is_file())
    code, out, err = rig("batch", str(plan), "--json")
    data = json.loads(out)
    assert code == 3, err
    made, failed = data["rows"]
    assert (made["failed"], made["already_there"], made["iterations"]) == (None, False, 20)
    assert made["db"] > 5
    assert 0.5 < estimate["more"] / (made["disk"] - before) < 2
    assert 0.2 < estimate["processor_seconds"] / made["processor_seconds"] < 5
    assert (toy / "exports" / "small" / "scene.ply").is_file()
    assert (failed["failed"], failed["scene"]) == ("reconstruct", "hdr-gs standard")
    assert "1 scene of 2 could not be made" in data["missing"]
    assert failed["says"] in data["missing"]
    page = Path(data["report"]).read_text()
    assert "toy/reconstructions/small/report.html" in page
    assert "reconstruct failed" in page


def test_parts_of_a_plan_are_made_apart_and_joined(rig, toy: Path) -> None:
    plan = toy.parent / "PLAN.toml"
    plan.write_text(
        'sessions = ["toy"]\n[[scene]]\nname = "small"\n'
        'set = { iterations = 10, gaussians = 300, refine = "none", environment = false }\n'
    )
    code, out, err = rig("batch", str(plan), "--shard", "2/2", "--json")
    assert (code, json.loads(out)["rows"]) == (0, []), err
    code, out, err = rig("batch", str(plan), "--merge", "--json")
    assert code == 2
    assert "1 of 1 scenes have no result, such as small of" in json.loads(out)["missing"]
    code, out, err = rig("batch", str(plan), "--shard", "1/2", "--json")
    assert code == 0, err
    assert json.loads(out)["report"] == str(toy.parent / "PLAN.1-of-2.batch.html")
    code, out, err = rig("batch", str(plan), "--merge", "--json")
    assert code == 0, err
    (row,) = json.loads(out)["rows"]
    assert row["session"] == str(toy)
    assert row["processor_seconds"] > 0.3
    assert row["peak"] > 100_000_000


def test_no_cluster_is_said(rig, toy: Path) -> None:
    pytest.importorskip("ray")
    plan = toy.parent / "PLAN.toml"
    plan.write_text('sessions = ["toy"]')
    code, _, err = rig("batch", str(plan), "--ray", "127.0.0.1:1")
    assert code == 2
    assert "No Ray cluster answers at 127.0.0.1:1" in err


def test_a_cluster_is_given_paths_that_hold_in_every_folder(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / SESSION).touch()
    (tmp_path / "PLAN.toml").write_text('sessions = ["s"]')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command_processes, "begun", lambda *given: nullcontext())
    plans: list[BatchPlan] = []

    def carried_out(plan: BatchPlan, *given: object, **options: object) -> BatchResult:
        plans.append(plan)
        return BatchResult(plan=plan.path, rows=())

    monkeypatch.setattr(run, "carry_out", carried_out)
    assert rig("batch", "PLAN.toml", "--ray", "auto")[0] == 0
    assert [plan.sessions for plan in plans] == [(tmp_path / "s",)]


def test_what_is_made_in_part_is_missing_in_the_end(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / SESSION).touch()
    plan = tmp_path / "PLAN.toml"
    plan.write_text('sessions = ["s"]')
    whole = BatchRow(session=tmp_path / "s", scene="one")
    rows = (whole, whole.model_copy(update={"says": "A view has no pose."}))
    monkeypatch.setattr(run, "carry_out", lambda *given, **options: BatchResult(plan=plan, rows=rows))
    code, out, _ = rig("batch", str(plan), "--json")
    assert code == 3
    assert json.loads(out)["missing"] == (
        f"1 scene of 2 could only be made in part; {tmp_path}/s: A view has no pose."
    )


def test_a_scene_is_trained_from_storage_into_storage(rig, toy: Path) -> None:
    cloud = toy.parent / "cloud"
    shutil.copytree(toy, cloud / "scans" / "toy")
    before = {path: path.stat().st_mtime_ns for path in cloud.rglob("*")}
    plan = toy.parent / "PLAN.toml"
    plan.write_text(
        f'sessions = ["file://{cloud}/scans/*"]\noutput = "file://{cloud}/scenes"\n'
        '[[scene]]\nname = "small"\nexport = ["scene.ply"]\n'
        'set = { iterations = 10, gaussians = 300, refine = "none", environment = false }\n'
    )
    code, out, err = rig("batch", str(plan), "--shard", "1/1", "--json")
    assert code == 0, err
    (row,) = json.loads(out)["rows"]
    stored = cloud / "scenes" / "toy"
    assert row["stored"] == f"file://{stored}"
    assert {path: path.stat().st_mtime_ns for path in before if path != cloud} == {
        path: time for path, time in before.items() if path != cloud
    }
    # It is a session without its photographs: scenes of it are exported and looked at as those of any other.
    code, out, err = rig("export", str(stored / row["reconstruction"]), "--out", str(toy / "again.ply"))
    assert code == 0, err
    assert (toy / "again.ply").read_bytes() == (stored / "exports" / "small" / "scene.ply").read_bytes()
    code, out, err = rig("batch", str(plan), "--merge", "--json")
    assert code == 0, err
    assert row["stored"] in Path(json.loads(out)["report"]).read_text()
    code, out, err = rig("batch", str(plan), "--json")
    assert code == 0, err
    assert json.loads(out)["rows"][0]["already_there"]
