"""A training that meets numbers which are none ends with one sentence that names the view."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imaging.errors import ReconstructionError
from recon.observe.refinement import Refinement
from recon.scene.environment import Environment
from recon.train.densification import DensityRules
from recon.train.finite_losses import FiniteLosses
from recon.train.monitor import Hooks
from recon.train.trainer import train
from recon.train.training import Plan, Training
from tests.recon.beginning import beginning

VICTIM = 2


@pytest.fixture
def begun(toy_dataset):
    """A training on the toy session."""
    return beginning(toy_dataset, 200)(refinement=Refinement.of(toy_dataset, ("exposures",)))


def run(training, dataset, saved, iterations=40):
    plan = Plan(iterations, DensityRules(300), checkpoint_seconds=0.0)
    train(training, dataset, plan, Hooks(save=lambda: saved.append(training.iteration)))


def poisoned(dataset, value, what):
    """The data set with one view that has a number which is none, or one too large."""
    view = dataset.train[VICTIM]
    shot = view.shots[1]
    if what == "pixel":
        pixels = shot.pixels.copy()
        pixels[7, 9] = value
        shot = shot.showing(pixels=pixels)
    elif what == "exposure":
        shot = replace(shot, k=value)
    shots = (view.shots[0], shot, *view.shots[2:])
    sensor = view.sensor
    if what == "falloff":
        falloff = sensor.falloff.copy()
        falloff[0, 0] = value
        sensor = replace(sensor, falloff=falloff)
    bad = replace(view, shots=shots, sensor=sensor)
    return bad.name, replace(dataset, train=(*dataset.train[:VICTIM], bad, *dataset.train[VICTIM + 1 :]))


@pytest.mark.parametrize(
    ("what", "value"),
    [
        ("pixel", np.nan),
        ("pixel", np.inf),
        ("exposure", 1e60),
        ("exposure", np.nan),
        ("falloff", np.nan),
        ("falloff", np.inf),
    ],
)
def test_the_view_is_named_and_nothing_spoilt_is_saved(begun, toy_dataset, what, value):
    name, dataset = poisoned(toy_dataset, value, what)
    saved = []
    with pytest.raises(ReconstructionError, match=rf"loss of view {name} is (nan|inf)") as failure:
        run(begun, dataset, saved)
    assert str(failure.value).count(". ") == 0
    assert len(saved) == begun.iteration  # of the iterations before that one
    assert all(torch.isfinite(value).all() for value in begun.gaussians.parameters.values())


@pytest.mark.parametrize("what", ["exposures", "environment"])
def test_what_all_views_share_is_not_blamed_on_one(begun, toy_dataset, what):
    training = begun
    if what == "environment":
        far = Environment(torch.full((3, 4, 8), torch.nan), np.eye(3))
        training = Training.begin(
            begun.method, begun.light, begun.gaussians, toy_dataset.extent, environment=far
        )
    else:
        value = next(iter(begun.refinement.parameters.values()))
        training.iteration = 30
        with torch.no_grad():
            value.fill_(torch.nan)
    with pytest.raises(ReconstructionError, match="not finite any more, so train with another --seed"):
        run(training, toy_dataset, [])


def test_a_loss_on_a_gpu_is_read_when_asked_for(begun, toy_dataset):
    """Read no tensors off the CPU as they come."""
    losses = FiniteLosses(begun)
    losses.add(toy_dataset.train[0], torch.zeros((), device="meta"))  # a read of it would fail
    with pytest.raises((NotImplementedError, RuntimeError), match="meta"):
        losses.require()
