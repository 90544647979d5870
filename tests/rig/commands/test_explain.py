"""`rig explain`: the rungs that the records hold, as a table and as JSON."""

import json
import shutil

import pytest

from imaging.files import store
from imaging.session.records import Rung


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")


def test_a_scene_is_explained_stage_by_stage(rig, scene) -> None:
    code, out, err = rig("explain", str(scene))
    assert (code, err) == (0, "")
    capture, calibration, model = (part.splitlines() for part in out.replace("\n\n", "\0").split("\0", 2))
    assert "1 plan" in capture[0]
    assert "3 exposures x 3 frames x 2" in " ".join(capture)
    assert "1/1000 s f/4 ISO 100 to" in " ".join(capture)
    assert "3 parts considered, 1 taken" in calibration[0]
    (row,) = [line for line in calibration if line.lstrip().startswith("vignetting")]
    assert row.split()[1] == "yes"
    assert "(+0.031 ± 0.004 stops)" in " ".join(" ".join(calibration).split())
    assert "nh-3dgs" in model[0]
    assert "20 iterations" in model[0]
    assert any(line.lstrip().startswith("one-sided saturation") for line in model)
    assert any(line.lstrip().startswith("number of Gaussians") for line in model)
    assert "at most 400, not tried, since a draft" in " ".join(" ".join(model).split())
    assert any(line.lstrip().startswith("direction-dependent") for line in model)


def test_json_has_every_rung_of_both_records(rig, scene) -> None:
    folder = scene / "reconstructions" / "nh-3dgs-draft"
    code, out, _ = rig("explain", str(folder), "--json")
    data = json.loads(out)
    assert code == 0
    calibration = store.read_json(scene / "calibration" / "calibration.json")
    assert data["calibration"] == [Rung(**rung).model_dump() for rung in calibration["rungs"]]
    assert data["model_rungs"] == store.read_json(folder / "model.json")["rungs"]
    (plan,) = data["capture"]
    assert (plan["exposures"], plan["frames"], plan["cameras"], plan["shots"]) == (3, 3, 2, 18)
    assert plan["reason"]
    assert not data["calibration_is_stale"]


def test_a_scene_of_a_session_whose_calibration_was_removed(rig, scene) -> None:
    shutil.rmtree(scene / "calibration")
    code, out, err = rig("explain", str(scene / "reconstructions" / "nh-3dgs-draft"))
    assert (code, err) == (0, "")
    assert "3 parts considered, 1 taken" in out
    assert "calibrated again" not in out


def test_a_calibrated_session_without_a_scene(rig, toy) -> None:
    code, out, _ = rig("explain", str(toy))
    assert code == 0
    assert out.splitlines()[-2:] == [f"{toy}: no reconstruction yet", f"Next: rig reconstruct {toy}"]
    assert json.loads(rig("explain", str(toy), "--json")[1])["reconstruction"] is None


def test_what_is_out_of_date_is_said(rig, scene) -> None:
    path = scene / "calibration" / "calibration.json"
    record = store.read_json(path)
    store.write_json(path, record | {"created": "2999-01-01T00:00:00Z", "shots_sha256": "0" * 64})
    code, out, _ = rig("explain", str(scene))
    assert code == 0
    assert "OUT OF DATE, shots were added since" in out
    assert "the session was calibrated again since" in out
    assert json.loads(rig("explain", str(scene), "--json")[1])["model_is_stale"]
    # The scene itself goes by the calibration that it was trained on.
    code, out, _ = rig("explain", str(scene / "reconstructions" / "nh-3dgs-draft"))
    assert code == 0
    assert "OUT OF DATE" not in out
    assert "the session was calibrated again since" in out


def test_a_scene_away_from_its_session_is_explained(rig, scene, tmp_path) -> None:
    folder = scene / "reconstructions" / "nh-3dgs-draft"
    within = json.loads(rig("explain", str(folder), "--json")[1])
    moved = shutil.copytree(folder, tmp_path / "sent")
    shutil.rmtree(scene)
    code, out, err = rig("explain", str(moved), "--json")
    data = json.loads(out)
    assert (code, err, data["session"], data["capture"]) == (0, "", None, [])
    for name in ("calibration", "model", "model_rungs"):
        assert data[name] == within[name]
    assert "vignetting" in rig("explain", str(moved))[1]


def test_costs_are_told_where_they_were_counted_and_long_reasons_wrap(rig, toy) -> None:
    path = toy / "calibration" / "calibration.json"
    record = store.read_json(path)
    reason = "a falloff, since [red]corners[/red] are \x1b[2J dark " + "and darker " * 20
    rungs = [Rung.judged("vignetting", 1.0, 0.1, "stops", reason, parameters=3).model_dump(mode="json")]
    store.write_json(path, record | {"rungs": rungs})
    code, out, _ = rig("explain", str(toy))
    assert code == 0
    assert "(+1 ± 0.1 stops, 3 parameters)" in " ".join(out.split())
    assert "[red]corners[/red]" in " ".join(out.split())
    assert "\x1b" not in out
    assert max(map(len, out.splitlines()[1:-1])) <= 120
    assert out.count("darker") == 20


def test_a_session_without_a_calibration_is_told_what_to_do(rig, toy) -> None:
    store.discard(toy / "calibration" / "calibration.json")
    code, out, err = rig("explain", str(toy))
    assert (code, out) == (2, "")
    assert err == f"{toy} has nothing to explain yet: run `rig calibrate` first.\n"


@pytest.mark.parametrize("where", ["nowhere", "."])
def test_what_is_no_session_is_one_sentence(rig, tmp_path, where) -> None:
    code, out, err = rig("explain", str(tmp_path / where))
    assert (code, out, err.count("\n")) == (2, "", 1)


@pytest.mark.parametrize("damaged", ["calibration/calibration.json", "plans.jsonl", "session.json"])
def test_damaged_records_are_one_sentence(rig, toy, damaged) -> None:
    (toy / damaged).write_bytes(b'{"x": 1}\n{"y": 2}\n')
    code, out, err = rig("explain", str(toy))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "defect" not in err
