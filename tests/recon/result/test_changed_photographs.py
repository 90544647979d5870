"""A training goes on, or counts as finished, only where what it may use is as it was."""

import json
import shutil
from dataclasses import replace

import pytest

import recon.reconstruct as stage
from imaging.errors import InputError, ReconstructionError
from recon.data.load import load
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.model import CHECKPOINT
from recon.scene.checkpoint import read_checkpoint, write_checkpoint
from recon.train.interrupt import Interrupted

REQUEST = TrainingRequest(quality="draft", name="c1", overrides=Overrides(refine="poses"))


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(10, 200, 32))


@pytest.fixture
def stopped(monkeypatch):
    """Have trainings stopped by the user after five iterations."""
    train = stage.train

    def stopping(training, dataset, plan, hooks, **options):
        train(training, dataset, plan, hooks, until=5, **options)
        hooks.save()
        raise KeyboardInterrupt

    monkeypatch.setattr(stage, "train", stopping)


def change(session, what):
    """Leave the first view out, or give its shots other masks."""
    path = session / "shots.jsonl"
    shots = [json.loads(line) for line in path.read_text().splitlines()]
    place = [(shot["frame"], shot["camera"]) for shot in shots]
    remaining = [shot for shot, view in zip(shots, place, strict=True) if view != place[0]]
    masked = [
        shot | ({"mask_sha256": "0" * 64} if view == place[0] else {})
        for shot, view in zip(shots, place, strict=True)
    ]
    lines = remaining if what == "photographs" else masked
    path.write_text("".join(json.dumps(shot) + "\n" for shot in lines))


@pytest.mark.parametrize("what", ["photographs", "masks"])
def test_a_finished_scene_of_other_photographs_is_not_returned(session_copy, what):
    folder = reconstruct(session_copy, REQUEST)
    change(session_copy, what)
    with pytest.raises(InputError, match="c1 exists already, trained on other photographs or masks:"):
        reconstruct(session_copy, REQUEST)
    with pytest.raises(ReconstructionError, match=r"reconstruct again with --replace; "):
        evaluate(folder)


def test_nor_does_a_stopped_training_go_on_with_them(session_copy, stopped):
    with pytest.raises(Interrupted):
        reconstruct(session_copy, REQUEST)
    change(session_copy, "photographs")
    with pytest.raises(InputError, match="trained on other photographs or masks:"):
        reconstruct(session_copy, REQUEST)


@pytest.mark.parametrize("depth", [None, 0.0])
def test_other_depth_maps_are_another_training_where_they_may_be_used(toy_deep, tmp_path, depth):
    session = shutil.copytree(toy_deep, tmp_path / "session")
    request = replace(REQUEST, overrides=Overrides(refine="poses", depth=depth))
    folder = reconstruct(session, request)
    path = session / "shots.jsonl"
    shots = [json.loads(line) for line in path.read_text().splitlines()]
    path.write_text("".join(json.dumps(shot | {"depth_sha256": "0" * 64}) + "\n" for shot in shots))
    if depth == 0:
        assert reconstruct(session, request) == folder
    else:
        with pytest.raises(InputError, match="c1 exists already, trained on other depth maps:"):
            reconstruct(session, request)
    assert evaluate(folder)


def test_a_scene_of_a_session_without_depth_maps_is_known_by_a_checkpoint_of_before(session_copy):
    """Such checkpoints have no hash of depth maps."""
    folder = reconstruct(session_copy, REQUEST)
    checkpoint = read_checkpoint(folder / CHECKPOINT)
    facts = {name: value for name, value in checkpoint.facts.items() if name != "depths_sha256"}
    write_checkpoint(folder / CHECKPOINT, replace(checkpoint, facts=facts))
    assert reconstruct(session_copy, REQUEST) == folder


def test_the_hash_of_depth_maps_is_of_their_content_and_units_alone(toy):
    plain = load(toy, max_width=32)
    hashes = {(plain.photographs_sha256, plain.depths_sha256)}
    for digest, unit in (("0", 1.0), ("1", 1.0), ("0", 0.001)):
        said = {"depth": "depths/a.npy", "depth_sha256": digest * 64, "depth_unit": unit}
        records = tuple(shot.model_copy(update=said) for shot in plain.records)
        measured = replace(plain, records=records)
        hashes.add((measured.photographs_sha256, measured.depths_sha256))
    assert (len({one for one, _ in hashes}), len({other for _, other in hashes})) == (1, 4)
    assert plain.depths_sha256 == ""
