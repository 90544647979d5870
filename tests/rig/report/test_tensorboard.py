"""What TensorBoard shows of a training is its log, and what an evaluation drew."""

from pathlib import Path

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from imaging.errors import InputError, StorageError
from imaging.files import store
from imaging.session.paths import find_reconstruction
from rig.report.tensorboard import TensorBoardLog


@pytest.fixture(scope="module")
def logged(scene_template: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, EventAccumulator]:
    """A scene, and its log written twice over, as by a training that was stopped and went on."""
    scene, folder = find_reconstruction(scene_template), tmp_path_factory.mktemp("events") / "run"
    lines = store.read_lines(scene / "train.jsonl")
    for upto in (len(lines) - 1, len(lines)):
        log = TensorBoardLog(folder)
        for line in lines[:upto]:
            log.line(line)
        log.pictures(scene, int(lines[-1]["iteration"]))
        log.close()
    events = EventAccumulator(str(folder))
    events.Reload()
    return scene, events


def test_curves_are_the_numbers_of_the_log(logged: tuple[Path, EventAccumulator]) -> None:
    scene, events = logged
    lines = store.read_lines(scene / "train.jsonl")
    for name in ("loss", "gaussians", "seconds", "held_out_db"):
        expected = [(line["iteration"], line[name]) for line in lines if name in line]
        found = [(event.step, event.value) for event in events.Scalars(f"training/{name}")]
        assert [step for step, _ in found] == [step for step, _ in expected]
        np.testing.assert_allclose(
            [value for _, value in found], [value for _, value in expected], rtol=1e-6, atol=1e-7
        )


def test_pictures_are_those_of_the_evaluation(logged: tuple[Path, EventAccumulator]) -> None:
    scene, events = logged
    names = sorted(path.stem for path in (scene / "renders").glob("*.png"))[:4]
    assert names
    for name in names:
        assert f"{name}/renders" in events.Tags()["images"]
        assert f"{name}/references" in events.Tags()["images"]


def test_a_file_in_the_place_of_the_folder_is_refused_before_training(rig, toy: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    code, out, err = rig("reconstruct", str(toy), "--tensorboard", str(tmp_path / "file"))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (toy / "reconstructions").exists()
    with pytest.raises(StorageError):
        TensorBoardLog(tmp_path / "file")


def test_without_tensorboard_the_option_says_how_to_get_it(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("rig.report.tensorboard.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'hdr-rig\[tensorboard\]'"):
        TensorBoardLog(tmp_path)


def test_reconstruct_logs_while_it_trains(rig, toy: Path, tmp_path: Path) -> None:
    options = ["--quality", "draft", "--set", "iterations=20", "--set", "gaussians=300", "--set", "width=32"]
    options += ["--set", "refine=none", "--set", "environment=0", "--set", "degree=0"]
    code, _, err = rig("reconstruct", str(toy), *options, "--tensorboard", str(tmp_path / "run"))
    assert (code, err) == (0, "")
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    assert events.Scalars("training/loss")[-1].step == 20
    assert events.Tags()["images"]
