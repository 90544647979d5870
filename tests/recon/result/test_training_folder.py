"""No scene is lost by training another: where trainings are kept, and what replaces what."""

import json
from pathlib import Path

import pytest

import recon.reconstruct as stage
from imaging.errors import InputError, StorageError
from imaging.session.paths import session_of
from recon.decide.cost.budget import Budget
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.result.training_folder import default_name, names_of
from recon.train.interrupt import Interrupted
from tests.trees import tree


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(20, 200, 32))


@pytest.fixture
def scene(session_copy) -> Path:
    """A finished one."""
    return reconstruct(session_copy, TrainingRequest(quality="draft", name="c1"))


def test_a_scene_is_called_by_what_was_asked_for():
    assert default_name("hdr-gs", "best", None) == "hdr-gs-best"
    budgets = [Budget.parse(text) for text in ("5m", "30MB", "35dB", "20k")]
    names = [default_name("nh-3dgs", "standard", budget) for budget in budgets]
    assert names == [f"nh-3dgs-standard-{end}" for end in ("300s", "30MB", "35dB", "20k")]
    assert names_of(TrainingRequest(name="c1")) == ("c1",)
    assert names_of(TrainingRequest(method="hdr-gs", quality="best")) == ("hdr-gs-best",)
    assert names_of(TrainingRequest(method="vanilla", all_views=True)) == ("vanilla-standard-all",)
    assert names_of(TrainingRequest()) == ("nh-3dgs-standard", "hdr-gs-standard", "vanilla-standard")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"seed": 7}, "trained with seed 0:"),
        ({"budget": Budget.parse("0.2k")}, "trained with budget none:"),
        ({"all_views": True}, "trained with held-out views as usual:"),
        (
            {"overrides": Overrides(degree=0), "early_stop": True},
            "trained with early stop off, settings of the preset:",
        ),
    ],
)
def test_other_settings_do_not_overwrite_a_scene(scene, options, words):
    session, before = scene.parent.parent, tree(scene.parent)
    with pytest.raises(InputError, match=rf"c1 exists already, {words}.* --name, or --replace"):
        reconstruct(session, TrainingRequest(quality="draft", name="c1", **options))
    assert tree(scene.parent) == before


def test_nor_does_a_version_with_other_presets(scene, monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(20, 300, 32))
    before = tree(scene)
    with pytest.raises(InputError, match=r"c1 exists already, trained by another version of rig:"):
        reconstruct(scene.parent.parent, TrainingRequest(quality="draft", name="c1"))
    assert tree(scene) == before


def test_nor_does_another_calibration(scene):
    path = scene.parent.parent / "calibration" / "calibration.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"reprojection_px": 0.9}))
    before = tree(scene)
    with pytest.raises(InputError, match="an earlier calibration"):
        reconstruct(scene.parent.parent, TrainingRequest(quality="draft", name="c1"))
    assert tree(scene) == before


def test_a_replacement_keeps_the_scene_until_it_is_finished(scene):
    session, before = scene.parent.parent, tree(scene)

    def interrupt(message: str, done: int, total: int) -> None:
        assert tree(scene) == before
        if "loss" in message and done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct(
            session, TrainingRequest(quality="draft", name="c1", seed=7, replace=True), on_progress=interrupt
        )
    assert tree(scene) == before
    assert reconstruct(session, TrainingRequest(quality="draft", name="c1", seed=7, replace=True)) == scene
    assert read_model(scene).settings.seed == 7
    assert [path.name for path in scene.parent.iterdir()] == ["c1"]
    plain = reconstruct(session, TrainingRequest(quality="draft", name="plain", seed=7))
    assert (plain / "splats.ply").read_bytes() == (scene / "splats.ply").read_bytes()


def test_a_scene_under_way_is_trained_by_one_alone(session_copy, monkeypatch):
    folder = session_copy / "reconstructions" / "c1"
    before = {path.name for path in session_copy.iterdir()}

    def second(*given, **options):
        with pytest.raises(InputError, match=rf"^{folder} is being made by another rig: wait for it to end"):
            reconstruct(session_copy, TrainingRequest(quality="draft", name="c1", seed=7, replace=True))
        raise KeyboardInterrupt

    monkeypatch.setattr(stage, "train", second)
    with pytest.raises(KeyboardInterrupt):
        reconstruct(session_copy, TrainingRequest(quality="draft", name="c1"))
    assert {path.name for path in session_copy.iterdir()} - before == {"reconstructions"}


def test_a_replacement_that_was_stopped_goes_on(scene, monkeypatch):
    """Stop it by the user, who finds both: the old scene, and the state of the new one."""
    session, before, iterations = scene.parent.parent, tree(scene), []

    def progress(message: str, done: int, total: int) -> None:
        if "loss" in message:
            iterations.append(done)

    def stopping(training, dataset, plan, hooks, **options):
        train(training, dataset, plan, hooks, until=10, **options)
        hooks.save()
        raise KeyboardInterrupt

    train = stage.train
    monkeypatch.setattr(stage, "train", stopping)
    with pytest.raises(Interrupted, match=r"\.c1\.new has the scene after 10 iterations"):
        reconstruct(session, TrainingRequest(quality="draft", name="c1", seed=7, replace=True))
    assert tree(scene) == before
    assert read_model(scene.with_name(".c1.new")).ending == "interrupted"
    monkeypatch.setattr(stage, "train", train)
    reconstruct(
        session, TrainingRequest(quality="draft", name="c1", seed=7, replace=True), on_progress=progress
    )
    assert min(iterations) > 10
    assert (read_model(scene).settings.seed, read_model(scene).ending) == (7, "schedule")


def test_the_disk_is_tried_before_any_picture_is_read(session_copy):
    (session_copy / "reconstructions").write_text("in the way")

    def progress(message: str, done: int, total: int) -> None:
        pytest.fail(f"{message} began")

    with pytest.raises(StorageError, match="a file is in the place of a folder"):
        reconstruct(session_copy, TrainingRequest(quality="draft"), on_progress=progress)
    assert (session_copy / "reconstructions").read_text() == "in the way"


def test_scenes_may_lie_on_another_disk(session_copy, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    (session_copy / "reconstructions").symlink_to(disk)
    scene = reconstruct(session_copy, TrainingRequest(quality="draft", name="c1"))
    assert scene == session_copy / "reconstructions" / "c1"
    assert [path.name for path in disk.iterdir() if path.is_dir()] == ["c1"]
    assert session_of(scene) == session_copy.resolve()
