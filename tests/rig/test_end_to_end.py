"""A toy session through every command, and the demo through its stages."""

import json
import shutil
from pathlib import Path

import pytest

from capture.request import CaptureRequest
from imaging.files import store
from recon.decide.request import TrainingRequest
from rig.commands import demo
from rig.terminal.result import CommandResult
from tests.rig.report.pages import Page, assert_self_contained

from .conftest import Silence, calibrated_from_truth


def json_of(rig, *arguments: str) -> dict:
    """The JSON of a command that has to succeed."""
    code, out, err = rig(*arguments, "--json")
    assert code == 0
    assert [line for line in err.splitlines() if not line.startswith("Next: rig render")] == []
    value = json.loads(out)
    assert value["exit_code"] == 0
    return value


def test_capture_plan_check_and_resume(rig, tmp_path: Path) -> None:
    folder = tmp_path / "S"
    planned = json_of(rig, "capture", "--sim", "toy", str(folder), "--dry-run", "--frames", "2")
    assert not folder.exists()
    taken = json_of(rig, "capture", "--sim", "toy", str(folder), "--frames", "2", "--seed", "5")
    assert planned["shots"] == taken["taken"] == 2 * 2 * len(planned["bracket"])
    assert json_of(rig, "check", str(folder))["problems"] == []

    (folder / "raw" / "0001" / "cam1_0.dng").unlink()
    lines = (folder / "shots.jsonl").read_text().splitlines(keepends=True)
    (folder / "shots.jsonl").write_text("".join(line for line in lines if "0001/cam1_0.dng" not in line))
    resumed = json_of(rig, "capture", "--sim", "toy", str(folder), "--seed", "5", "--resume")
    assert (resumed["taken"], resumed["earlier"]) == (1, taken["taken"] - 1)


def test_the_bracket_can_be_chosen(rig, tmp_path: Path) -> None:
    folder = str(tmp_path / "S")
    json_of(rig, "capture", "--sim", "toy", folder, "--frames", "1", "--bracket", "3,-3")
    exposures = json_of(rig, "check", folder)["exposures"]
    times = sorted({one["exposure"]["time"] for one in exposures})
    assert len(times) == 2
    assert times[1] / times[0] == pytest.approx(64, rel=0.05)


def test_repair_brings_back_a_lost_index(rig, toy: Path) -> None:
    (toy / "shots.jsonl").write_text("")
    assert rig("check", str(toy))[0] == 2
    repaired = json_of(rig, "check", str(toy), "--repair")
    assert len(repaired["repaired"]["added"]) == repaired["sound"] == 18


def test_import_of_captured_files(rig, toy: Path, tmp_path: Path) -> None:
    value = json_of(rig, "import", str(toy / "raw"), str(tmp_path / "I"))
    assert (value["cameras"], value["shots"]) == (2, 18)
    assert value["guesses"]


def test_the_response_alone(rig, toy: Path) -> None:
    shutil.rmtree(toy / "calibration")
    value = json_of(rig, "calibrate", str(toy), "--only", "response")
    assert value["responses"] == {"cam0": "linear", "cam1": "linear"}
    page = Page.read(Path(value["report"]))
    assert_self_contained(page)
    assert "Exposures and cameras; poses were not asked for" in page.text
    code, _, err = rig("reconstruct", str(toy))
    assert code == 2
    assert "no view with a pose" in err


def test_reconstruct_evaluate_and_render(rig, scene: Path, tmp_path: Path) -> None:
    recon = scene / "reconstructions" / "nh-3dgs-draft"
    before = store.read_json(recon / "metrics.json")
    (value,) = json_of(rig, "evaluate", str(scene))["scenes"]
    assert value["reconstruction"] == str(recon)
    assert value["metrics"]["hdr_psnr_mu_aligned"] == pytest.approx(before["hdr_psnr_mu_aligned"])
    assert value["metrics"]["views"]

    (rendered,) = json_of(rig, "render", str(recon), "--out", str(tmp_path / "out"))["scenes"]
    files = rendered["files"]
    assert all(Path(file).is_file() for file in files)
    assert {Path(file).stem for file in files if file.endswith(".exr")} == {
        f"{frame:04d}_cam{camera}" for frame in range(3) for camera in range(2)
    }

    page = Page.read(recon / "report.html")
    assert_self_contained(page)
    for words in (
        f"{before['hdr_psnr_mu_p999']:.2f}",
        "width that they are measured at",
        "Held-out views, which the training never saw, beside the simulator's true light",
        "0001/cam0",
        "Truth, middle exposure",
        "rig reconstruct toy --method nh-3dgs --quality draft --seed 0",
        "What was captured",
        "What was calibrated",
    ):
        assert words in page.text, words
    # What is beside the page is listed with its size, each a link to a file that is there.
    beside = {entry.name for entry in recon.iterdir() if entry.is_file()} - {"report.html"}
    assert {one["href"] for one in page.all("a") if not one["href"].startswith("#")} == beside
    # The settings are told in words; the command tells the rest.
    assert "early stop" not in page.text
    # 3 exposures and their compressed truth above render and error map; 6 views of the contact sheet.
    assert len(page.all("img")) == 8 + 6


def test_without_truth_the_photograph_is_shown_beside_the_render(rig, scene: Path) -> None:
    shutil.rmtree(scene / "truth")
    (value,) = json_of(rig, "evaluate", str(scene))["scenes"]
    assert "hdr_psnr_mu" not in value["metrics"]
    assert "raw_psnr" in value["metrics"]
    page = Page.read(Path(value["report"]))
    assert_self_contained(page)
    assert "beside the photographs themselves" in page.text
    assert page.text.count("Photograph, ") == page.text.count("Render, ") == 3


def test_developed_photographs_end_to_end(rig, tmp_path: Path) -> None:
    folder = tmp_path / "ldr"
    json_of(rig, "capture", "--sim", "toy-ldr", str(folder))
    calibrated_from_truth(folder)
    value = json_of(rig, "reconstruct", str(folder), "--quality", "draft")
    assert value["metrics"]["method"] == "hdr-gs"
    assert value["metrics"]["ldr_psnr_oe"] > 5
    assert_self_contained(Page.read(Path(value["report"])))


def test_a_scene_of_too_few_views_says_that_nothing_was_measured(rig, tmp_path: Path) -> None:
    folder = tmp_path / "S"
    json_of(rig, "capture", "--sim", "toy", str(folder), "--frames", "1")
    calibrated_from_truth(folder)
    code, out, err = rig("reconstruct", str(folder), "--quality", "draft")
    assert code == 0
    assert err.startswith(f"Next: rig render {folder}/reconstructions/nh-3dgs-draft; the scene is there")
    assert err.count("\n") == 1
    assert "no view was held out" in out
    page = Page.read(folder / "reconstructions" / "nh-3dgs-draft" / "report.html")
    assert "Training views: none was held out" in page.text


class Steps:
    """Stands in for the stages of the demo, which take minutes; notes what was asked of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, out: Path, *, done: bool = False) -> None:
        self.calls: list[str] = []
        self.requests: list[TrainingRequest] = []
        recon = str(out / "reconstructions" / "demo")
        metrics = {
            "hdr_psnr_mu_p999": 39.71,
            "width": 480,
            "stops_median": 0.131,
            "pose_rotation_deg": 0.05,
            "pose_rotation_deg_max": 0.09,
            "pose_translation_relative": 0.004,
            "pose_translation_relative_max": 0.008,
        }
        self.note(monkeypatch, "run_capture", CommandResult({}, ["72 of 72 shots"], already_there=done))
        registered = {"registered": 24, "images": 24, "reprojection_px": 0.2}
        self.note(monkeypatch, "run_calibrate", CommandResult(registered, ["24 of 24"]))
        self.note(
            monkeypatch, "earlier_calibration", CommandResult(registered, ["24 of 24"], already_there=True)
        )
        trained = CommandResult({"reconstruction": recon}, ["trained"], already_there=done)
        self.note(monkeypatch, "run_training", trained)
        self.note(
            monkeypatch,
            "run_evaluate",
            CommandResult({"metrics": metrics, "report": f"{recon}/report.html"}, ["39.7"]),
        )

    def note(self, monkeypatch: pytest.MonkeyPatch, name: str, outcome: CommandResult) -> None:
        def stand_in(*arguments: object, **options: object) -> CommandResult:
            resumed = any(isinstance(one, CaptureRequest) and one.resume for one in arguments)
            self.calls.append(f"{name} resume" if resumed else name)
            self.requests += [one for one in arguments if isinstance(one, TrainingRequest)]
            return outcome

        monkeypatch.setattr(demo, name, stand_in)


def test_the_demo_ends_with_the_headline_numbers_and_the_report(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "demo"
    steps = Steps(monkeypatch, out)
    code, text, _ = rig("demo", str(out))
    assert code == 0
    assert steps.calls == ["run_capture", "run_calibrate", "run_training", "run_evaluate"]
    (request,) = steps.requests
    assert request.budget is not None
    assert (request.budget.unit, request.budget.amount <= 90) == ("s", True)
    lines = text.splitlines()
    assert lines[0] == (
        "Poses: off by 0.050 degrees and 0.40 % of the rig's size (median; at most 0.090 degrees and 0.80 %)"
    )
    assert "39.7 dB" in lines[1]
    assert "0.131 stops" in lines[1]
    assert lines[1].endswith(" at 480 px")
    assert lines[-2:] == [
        f"Report: {out}/reconstructions/demo/report.html",
        f"Next: rig render {out}/reconstructions/demo",
    ]
    assert [name for name in ("capture", "calibrate", "reconstruct", "evaluate") if name in lines[2]] == [
        "capture",
        "calibrate",
        "reconstruct",
        "evaluate",
    ]


def test_a_demo_that_was_stopped_goes_on_where_it_was(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = Steps(monkeypatch, toy)
    demo.run_demo(toy, Silence())
    assert steps.calls == ["run_capture resume", "earlier_calibration", "run_training", "run_evaluate"]


def test_a_demo_that_is_finished_does_not_tell_old_times_as_new(toy: Path, monkeypatch) -> None:
    Steps(monkeypatch, toy, done=True)
    seconds = iter(range(100))
    result = demo.run_demo(toy, Silence(), clock=lambda: next(seconds))
    assert "Time: evaluate 1.0 s; capture, calibrate, reconstruct done before" in result.lines
    assert result.data["seconds"] == {"evaluate": 1}


def test_a_demo_with_new_shots_is_calibrated_again(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = (toy / "shots.jsonl").read_text().splitlines(keepends=True)
    (toy / "shots.jsonl").write_text("".join(lines[:-1]))
    steps = Steps(monkeypatch, toy)
    demo.run_demo(toy, Silence())
    assert "run_calibrate" in steps.calls
