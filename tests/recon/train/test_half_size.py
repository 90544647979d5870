"""Half the size for the first half of a training: where it pays, and the same training if interrupted."""

from types import SimpleNamespace

import pytest
import torch

from recon.decide.cost.duration import slowdown
from recon.methods import METHODS
from recon.scene.checkpoint import read_checkpoint, write_checkpoint
from recon.train import half_size, trainer
from recon.train.densification import DensityRules
from recon.train.half_size import begins_halved, halves
from recon.train.trainer import train
from recon.train.training import Plan
from recon.train.training_checkpoint import checkpoint_of, light_in, restored
from tests.recon.beginning import beginning

CAP = 600


@pytest.fixture
def toys_too(monkeypatch):
    """Halve the views of toys, of 3072 pixels, as those of many pixels."""
    monkeypatch.setattr(half_size, "FEWEST", 0)


@pytest.mark.parametrize(
    ("pixels", "gaussians", "half"),
    [
        (1280 * 962, 60_000, True),
        (400 * 400, 40_000, True),
        (400 * 400, 80_000, False),
        (200 * 200, 5000, False),
    ],
)
def test_where_a_training_begins_at_half_size(pixels, gaussians, half):
    assert begins_halved(pixels, gaussians) == half
    view = SimpleNamespace(lens=SimpleNamespace(width=pixels, height=1), shots=[])
    assert halves([view], gaussians) == half
    assert (slowdown([view], gaussians) > 1) == half


@pytest.fixture(scope="module")
def begun(toy_dataset):
    """A function that makes a new training on the toy session, always the same."""
    return beginning(toy_dataset, 300)


def run(training, dataset, until=None):
    plan = Plan(30, DensityRules(CAP, every=0.1))
    train(training, dataset, plan, until=until)


def test_the_first_half_looks_at_half_the_size(begun, toy_dataset, toys_too, monkeypatch):
    widths, loss = [], trainer._loss

    def looked(training, renderer, view, *others):
        widths.append(view.lens.width)
        return loss(training, renderer, view, *others)

    monkeypatch.setattr(trainer, "_loss", looked)
    run(begun(), toy_dataset)
    assert widths == 15 * [32] + 15 * [64]


@pytest.mark.parametrize("stop", [9, 15, 21])
def test_a_training_that_was_stopped_goes_on_bit_for_bit(begun, toy_dataset, toys_too, tmp_path, stop):
    """Stopped while views have half their size, where that ends, and after it."""
    whole, first = begun(), begun()
    run(whole, toy_dataset)
    run(first, toy_dataset, until=stop)
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(first, {}))
    read = read_checkpoint(tmp_path / "c.safetensors")
    second = restored(METHODS["nh-3dgs"](toy_dataset, light_in(read)), read, toy_dataset.extent)
    run(second, toy_dataset)
    one, two = (checkpoint_of(training, {}).tensors for training in (whole, second))
    assert set(one) == set(two)
    for name, value in one.items():
        assert torch.equal(value, two[name]), name
