"""TensorBoard shows the log of a training, and its held-out views."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from imaging.errors import InputError, StorageError
from imaging.files import store
from imaging.session.paths import find_reconstruction
from recon.result.scene import open_scene
from rig.report.tensorboard import TensorBoardLog


@pytest.fixture(scope="module")
def logged(scene_template: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, EventAccumulator]:
    """A scene, and its log written twice over, by a training that was stopped and one that went on."""
    scene, folder = find_reconstruction(scene_template), tmp_path_factory.mktemp("events") / "run"
    lines = store.read_lines(scene / "train.jsonl")
    stopped = TensorBoardLog(folder)
    for line in lines[:-1]:
        stopped.line(line)
    stopped.close()
    went_on = TensorBoardLog(folder)
    went_on.finished(scene, logged=False)
    went_on.close()
    events = EventAccumulator(str(folder))
    events.Reload()
    return scene, events


def test_curves_are_the_numbers_of_the_log(logged: tuple[Path, EventAccumulator]) -> None:
    scene, events = logged
    lines = store.read_lines(scene / "train.jsonl")
    for name in ("loss", "gaussians", "seconds", "held_out_db"):
        expected = [(line["iteration"], line[name]) for line in lines if name in line]
        curve = [(event.step, event.value) for event in events.Scalars(f"training/{name}")]
        assert [step for step, _ in curve] == [step for step, _ in expected]
        np.testing.assert_allclose(
            [value for _, value in curve], [value for _, value in expected], rtol=1e-6, atol=1e-7
        )


def test_pictures_are_the_held_out_views_as_the_scene_shows_them(
    logged: tuple[Path, EventAccumulator],
) -> None:
    folder, events = logged
    scene = open_scene(folder)
    assert tuple(events.Tags()["images"]) == scene.record.held_out != ()
    for name in scene.record.held_out:
        (event,) = events.Images(name)
        assert event.step == scene.record.iterations
        shown = np.asarray(Image.open(BytesIO(event.encoded_image_string)).convert("RGB"))
        assert np.array_equal(shown, np.asarray(scene.at(0, name)))


def test_a_file_in_the_place_of_the_folder_is_refused_before_training(rig, toy: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    code, out, err = rig("reconstruct", str(toy), "--tensorboard", str(tmp_path / "file"))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (toy / "reconstructions").exists()
    with pytest.raises(StorageError):
        TensorBoardLog(tmp_path / "file")


def test_without_tensorboard_the_option_says_how_to_get_it(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("rig.report.tensorboard.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[tensorboard\]'"):
        TensorBoardLog(tmp_path)


def test_reconstruct_logs_while_it_trains(rig, toy: Path, tmp_path: Path) -> None:
    options = ["--quality", "draft", "--set", "iterations=20", "--set", "gaussians=300", "--set", "width=32"]
    options += ["--set", "refine=none", "--set", "environment=0", "--set", "degree=0"]
    code, _, err = rig("reconstruct", str(toy), *options, "--tensorboard", str(tmp_path / "run"))
    assert code == 0
    assert err.startswith("Next: rig render ")
    assert err.count("\n") == 1
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    assert events.Scalars("training/loss")[-1].step == 20
    assert events.Tags()["images"]
