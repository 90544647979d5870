"""`rig batch` as people use it: a session made into scenes, one that cannot be, and once more."""

import json
import os
import sys
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of the batch import this very code."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[3]), *sys.path]))
    monkeypatch.delenv("RAY_ADDRESS", raising=False)


def test_a_plan_is_carried_out_and_gone_on_with(rig, toy: Path) -> None:
    plan = toy.parent / "PLAN.toml"
    plan.write_text(
        'sessions = ["toy"]\n[[scene]]\nname = "small"\nexport = ["scene.ply"]\n'
        'set = { iterations = 20, gaussians = 300, refine = "none", environment = false }\n'
    )
    code, out, err = rig("batch", str(plan), "--json")
    assert code == 0, err
    (made,) = json.loads(out)["rows"]
    assert (made["failed"], made["iterations"]) == (None, 20)
    assert made["db"] > 5
    assert (toy / "exports" / "small" / "scene.ply").is_file()

    plan.write_text(
        plan.read_text().replace("[[scene]]", "[[scene]]\nbudget = '1s'\nmethod = 'hdr-gs'\n[[scene]]", 1)
    )
    code, out, err = rig("batch", str(plan))
    assert code == 3
    assert "already there" in out
    assert "reconstruct failed" in out
    assert "1 scene of 2 could not be made" in err
    page = (toy.parent / "PLAN.batch.html").read_text()
    assert "toy/reconstructions/small/report.html" in page
    assert "reconstruct failed" in page


def test_no_cluster_is_said(rig, toy: Path) -> None:
    pytest.importorskip("ray")
    plan = toy.parent / "PLAN.toml"
    plan.write_text('sessions = ["toy"]')
    code, _, err = rig("batch", str(plan), "--ray", "127.0.0.1:1")
    assert code == 2
    assert "No Ray cluster answers at 127.0.0.1:1" in err
