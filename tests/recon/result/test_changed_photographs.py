"""A training goes on, or counts as finished, only where its photographs and masks are as they were."""

import json

import pytest

import recon.reconstruct as stage
from imaging.errors import InputError, ReconstructionError
from imaging.session.session import Session
from recon.data.dataset import photographs_sha256
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
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
    with pytest.raises(InputError, match="c1 exists already, trained on other photographs, masks or"):
        reconstruct(session_copy, REQUEST)
    with pytest.raises(ReconstructionError, match=r"reconstruct again with --replace; "):
        evaluate(folder)


def test_nor_does_a_stopped_training_go_on_with_them(session_copy, stopped):
    with pytest.raises(Interrupted):
        reconstruct(session_copy, REQUEST)
    change(session_copy, "photographs")
    with pytest.raises(InputError, match="trained on other photographs, masks or depth maps"):
        reconstruct(session_copy, REQUEST)


def test_other_depth_maps_or_units_of_them_are_other_photographs(toy):
    plain = Session.open(toy).shots()
    measured, other, unit = (
        [shot.model_copy(update={"depth": "depths/a.npy"} | change) for shot in plain]
        for change in (
            {"depth_sha256": "0" * 64, "depth_unit": 1.0},
            {"depth_sha256": "1" * 64, "depth_unit": 1.0},
            {"depth_sha256": "0" * 64, "depth_unit": 0.001},
        )
    )
    assert len({photographs_sha256(shots) for shots in (plain, measured, other, unit)}) == 4
