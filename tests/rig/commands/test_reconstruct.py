"""`rig reconstruct`: budgets of every kind, what is predicted, and Ctrl-C."""

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from imaging.files import store
from imaging.session.session import SPLIT, Session, brackets
from recon.data.pixels import ShotSource
from recon.decide.cost.prediction import enough
from recon.decide.presets import QUALITIES, Quality
from tests.recon.ply_files import read_ply
from tests.recon.worlds import UTM, put

RECON = Path("reconstructions") / "nh-3dgs-draft"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A draft that is long enough to be cut short."""
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=60, gaussians=400, width=32))


@pytest.mark.parametrize(("budget", "most"), [("0.2k", 200), ("12KB", 178)])
def test_gaussians_and_bytes_limit_the_scene(rig, toy: Path, budget: str, most: int) -> None:
    code, out, _ = rig("reconstruct", str(toy), "--quality", "draft", "--budget", budget, "--json")
    data = json.loads(out)
    assert code == 0
    assert 0.9 * most < data["metrics"]["gaussians"] <= most
    assert data["predicted"]["low"] < data["predicted"]["db"] < data["predicted"]["high"]
    scene = toy / f"{RECON}-{budget}"
    assert data["held_out_db"] == store.read_json(scene / "model.json")["held_out_db"]
    assert data["metrics"]["raw_psnr"] == pytest.approx(data["held_out_db"], abs=0.01)
    if budget.endswith("KB"):
        assert (scene / "splats.ply").stat().st_size <= 12_000


def test_a_shot_is_decoded_once_for_training_evaluation_and_report(
    rig, toy: Path, quick: None, monkeypatch
) -> None:
    """By a relative name, as a user gives it, too."""
    decoded: list[str] = []

    def counted(source: ShotSource, k: float) -> object:
        decoded.append(source.path.name + source.path.parent.name)
        return read(source, k)

    read = ShotSource._read
    monkeypatch.setattr(ShotSource, "_read", counted)
    monkeypatch.chdir(toy.parent)
    code, _, _ = rig("reconstruct", toy.name, "--quality", "draft")
    assert code == 0
    assert len(decoded) == len(set(decoded)) == len(Session.open(toy).shots("scene"))
    rig("evaluate", str(toy / RECON))
    assert len(decoded) == 2 * len(set(decoded))


def test_a_scene_is_announced_when_it_is_there_and_its_report_is_short(
    rig, toy: Path, quick: None, monkeypatch
) -> None:
    """Before it is measured; and photographs are looked at for no longer than a quarter of the training."""
    from rig.report.sections import shots

    announced: list[bool] = []
    allowed: list[float] = []
    read = shots.read_previews

    def noted(session, progress, until):
        announced.append((toy / RECON / "splats.ply").is_file())
        allowed.append(until - time.monotonic())
        return read(session, progress, until)

    monkeypatch.setattr("rig.report.sections.captured.read_previews", noted)
    code, out, err = rig("reconstruct", str(toy), "--quality", "draft")
    assert code == 0
    assert announced == [True]
    assert allowed[0] <= store.read_json(toy / RECON / "model.json")["train_seconds"] / 4
    assert f"Next: rig render {toy / RECON}; the scene is there, its report follows" in err.splitlines()
    assert out.splitlines()[-1] == f"Next: rig render {toy / RECON}"


def test_views_that_the_report_has_no_time_for_are_said(rig, toy: Path, quick: None, monkeypatch) -> None:
    """By the command, in the record and on the page; `rig evaluate` measures all."""
    groups = list(brackets(Session.open(toy).shots("scene")).values())
    train, test = ([shot.file for group in part for shot in group] for part in (groups[::2], groups[1::2]))
    store.write_json(toy / SPLIT, {"schema_version": 1, "reason": "", "train": train, "test": test})
    monkeypatch.setattr("rig.commands.reconstruct.REPORT_SHARE", 0.0)
    code, out, _ = rig("reconstruct", str(toy), "--quality", "draft")
    said = "1 of 3 held-out views are measured, HDR-FLIP of none, to finish the report in time"
    assert code == 0
    assert said in out
    assert len(store.read_json(toy / RECON / "metrics.json")["views"]) == 1
    page = (toy / RECON / "report.html").read_text()
    assert said in page
    assert "1 of 3 are shown" in page
    code, out, _ = rig("evaluate", str(toy / RECON))
    assert "held-out views are measured" not in out
    assert len(store.read_json(toy / RECON / "metrics.json")["views"]) == 3


def test_more_gaussians_than_pixels_are_not_made(rig, toy: Path, monkeypatch) -> None:
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=4, gaussians=400, width=16))
    code, _, _ = rig("reconstruct", str(toy), "--quality", "draft", "--budget", "90k")
    assert code == 0
    assert store.read_json(toy / f"{RECON}-90k" / "model.json")["settings"]["max_gaussians"] == 5 * 16 * 12


def test_a_quality_that_is_reached_ends_the_training(rig, toy: Path, quick: None) -> None:
    code, out, err = rig("reconstruct", str(toy), "--quality", "draft", "--budget", "12dB", "--json")
    data = json.loads(out)
    assert (code, data["ending"]) == (0, "goal")
    assert err.startswith("predicted: held-out ")
    assert data["held_out_db"] >= 12
    assert data["iterations"] < 60


def test_figures_of_the_view_that_ended_a_training_are_called_so(rig, toy: Path, quick: None) -> None:
    code, out, _ = rig("reconstruct", str(toy), "--quality", "draft", "--budget", "12dB")
    assert code == 0
    assert ", validation " in out
    assert "RAW PSNR (validation) " in out
    page = (toy / f"{RECON}-12dB" / "report.html").read_text()
    assert "RAW PSNR (validation)" in page
    assert "1 of them to end the training by" in page
    assert "Looked at before" in page


def test_a_quality_that_is_not_reached_is_said_and_the_scene_stays(rig, toy: Path, quick: None) -> None:
    code, out, err = rig("reconstruct", str(toy), "--quality", "draft", "--budget", "80dB", "--json")
    data = json.loads(out)
    assert code == data["exit_code"] == 3
    assert "not 80 dB" in err
    assert (data["ending"], data["iterations"]) == ("schedule", 60)
    assert data["metrics"]["raw_psnr"] > 10


def test_a_quality_cannot_be_asked_for_where_nothing_is_held_out(rig, toy: Path) -> None:
    path = toy / "calibration" / "calibration.json"
    record = store.read_json(path)
    store.write_json(path, record | {"views": record["views"][:3]})
    code, _, err = rig("reconstruct", str(toy), "--quality", "draft", "--budget", "30dB")
    assert code == 2
    assert "too few views" in err
    assert err.count("\n") == 1


def test_ctrl_c_leaves_a_scene_and_the_same_command_ends_it(rig, toy: Path, quick: None, monkeypatch) -> None:
    """A true SIGINT after the third measurement."""
    append, measured = store.append_line, []

    def append_and_interrupt(path: Path, value: dict) -> None:
        append(path, value)
        if "held_out_db" in value:
            measured.append(value)
            if len(measured) == 3:
                os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(store, "append_line", append_and_interrupt)
    command = ["reconstruct", str(toy), "--quality", "draft"]
    code, out, err = rig(*command)
    assert (code, out) == (130, "")
    stopped = measured[2]["iteration"]
    assert f"has the scene after {stopped} iterations; run the same command again" in err
    model = store.read_json(toy / RECON / "model.json")
    assert (model["ending"], model["iterations"]) == ("interrupted", stopped)
    assert len(read_ply(toy / RECON / "splats.ply")["x"]) == model["gaussians"]
    code, out, _ = rig("evaluate", str(toy / RECON), "--json")
    assert (code, json.loads(out)["scenes"][0]["metrics"]["iterations"]) == (0, stopped)
    code, out, _ = rig(*command, "--json")
    data = json.loads(out)
    assert (code, data["ending"], data["iterations"]) == (0, "schedule", 60)


def test_early_stop_trains_no_longer_than_it_was_worth_and_says_so(rig, toy: Path, monkeypatch) -> None:
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=200, gaussians=300, width=16))
    code, out, _ = rig("reconstruct", str(toy), "--quality", "draft", "--early-stop", "--json")
    assert code == 0
    assert json.loads(out)["iterations"] <= enough(200) < 200
    model = store.read_json(toy / RECON / "model.json")
    assert model["settings"]["iterations"] == enough(200)
    (why,) = [rung for rung in model["rungs"] if rung["name"] == "early stop"]
    assert why["taken"]
    assert f"at most {enough(200)} of 200 iterations, as scenes before gained less than" in why["reason"]


def test_a_training_that_is_no_longer_than_its_worth_is_not_said_to_be_shortened(
    rig, toy: Path, monkeypatch
) -> None:
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=20, gaussians=300, width=16))
    assert enough(20) == 20
    code, _, _ = rig("reconstruct", str(toy), "--quality", "draft", "--early-stop", "--json")
    assert code == 0
    model = store.read_json(toy / RECON / "model.json")
    (why,) = [rung for rung in model["rungs"] if rung["name"] == "early stop"]
    assert not why["taken"]


def test_what_the_files_leave_out_of_far_coordinates_is_said(rig, toy: Path, monkeypatch) -> None:
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=4, gaussians=200, width=32))
    put(toy, 1.0, UTM)
    code, out, _ = rig("reconstruct", str(toy), "--quality", "draft")
    record = store.read_json(toy / RECON / "model.json")
    assert code == 0
    assert "less by {:.10g} {:.10g} {:.10g}, which".format(*record["offset"]) in " ".join(out.split())
    assert np.abs(np.array(record["offset"]) - UTM).max() < 100
