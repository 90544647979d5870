"""A reconstruction that was interrupted and called again gives the same files, byte for byte."""

import os
import shutil
import signal

import pytest

from imaging.files import store
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.model import CHECKPOINT, MODEL, SPLATS
from tests.recon.ply_files import read_ply

from .conftest import joined


@pytest.mark.parametrize(
    ("name", "method"), [("toy", "nh-3dgs"), ("toy-ldr", "hdr-gs"), ("toy", "vanilla"), ("mixed", "nh-3dgs")]
)
def test_interrupted_and_called_again(studio, train, tmp_path, name, method):
    session = tmp_path / "session"
    if name == "mixed":
        joined(studio.session("toy"), studio.session("toy-ldr"), session)
    else:
        shutil.copytree(studio.session(name), session, ignore=shutil.ignore_patterns("reconstructions"))
    whole = reconstruct(session, TrainingRequest(method=method, quality="draft", name="whole"))

    def interrupt(message: str, done: int, total: int) -> None:
        if "loss" in message and done < total:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        reconstruct(
            session, TrainingRequest(method=method, quality="draft", name="twice"), on_progress=interrupt
        )
    stopped = whole.with_name("twice")
    assert (stopped / CHECKPOINT).is_file()
    so_far = store.read_json(stopped / MODEL)
    assert so_far["ending"] == "interrupted"
    assert 0 < so_far["iterations"] < so_far["settings"]["iterations"]
    assert len(read_ply(stopped / SPLATS)["x"]) == so_far["gaussians"]
    assert evaluate(stopped).iterations == so_far["iterations"]
    again = reconstruct(session, TrainingRequest(method=method, quality="draft", name="twice"))
    assert again == stopped
    assert (again / SPLATS).read_bytes() == (whole / SPLATS).read_bytes()
    models = [store.read_json(folder / MODEL) for folder in (whole, again)]
    for model in models:
        del model["created"], model["train_seconds"], model["measuring_seconds"]
    assert models[0] == models[1]
