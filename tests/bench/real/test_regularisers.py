"""Regularisers change what they say, and one of nothing changes no bit."""

import numpy as np
import pytest
import torch

from bench.real.regularisers import Regularised, Regulariser
from bench.support import oracle
from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.methods import METHODS
from recon.start.initialisation import gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.trainer import train
from recon.train.training import Plan, Training

ITERATIONS = 40


def trained(dataset, regulariser):
    """Train, usually where the regulariser is None."""
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    start = start_points(dataset, images, 200, np.random.Generator(np.random.PCG64(0)))
    method = METHODS["hdr-gs"](dataset, light)
    if regulariser is not None:
        method = regulariser.method(method)
    gaussians = gaussians_at(start, method.appearance, method.observation.units)
    training = Training.begin(method, light, gaussians, dataset.extent)
    if regulariser is not None:
        training = Regularised(**vars(training))
        training.bind(regulariser, dataset, ITERATIONS, 0)
    plan = Plan(ITERATIONS, DensityRules(300))
    train(training, dataset, plan)
    return training


def ratio(training) -> float:
    lengths = training.gaussians.scales().detach().sort(1).values
    return float((lengths[:, 2] / lengths[:, 1]).max())


@pytest.fixture(scope="module")
def toy_dataset(made_once):
    return load(
        made_once("recon-toy-ldr", lambda folder: oracle.oracle_session(folder, "toy-ldr", points=300))
    )


@pytest.fixture(scope="module")
def usual(toy_dataset):
    return trained(toy_dataset, None)


def test_nothing_of_it_is_the_usual_training_bit_for_bit(toy_dataset, usual):
    same = trained(toy_dataset, Regulariser())
    for name, value in usual.gaussians.parameters.items():
        assert torch.equal(value, same.gaussians.parameters[name]), name


def test_axes_are_limited(toy_dataset, usual):
    limited = trained(toy_dataset, Regulariser(ratio=1.2))
    assert ratio(usual) > 1.5
    assert ratio(limited) < 1.2 * (1 + 1e-5)


@pytest.mark.parametrize(
    "regulariser", [Regulariser(opacity=0.3), Regulariser(decay=0.8)], ids=["opacity", "decay"]
)
def test_opacities_fall(toy_dataset, usual, regulariser):
    mean = trained(toy_dataset, regulariser).gaussians.opacities().mean()
    assert mean < 0.9 * usual.gaussians.opacities().mean()


def test_sizes_are_pulled_at(toy_dataset, usual):
    small = trained(toy_dataset, Regulariser(size=1.0))
    assert small.gaussians.scales().max(1).values.median() < usual.gaussians.scales().max(1).values.median()


def test_as_many_are_left_out_as_is_said_and_the_others_stand_in_for_them(toy_dataset, usual):
    usual = Training(**vars(usual))
    training = Regularised(**vars(usual))
    training.bind(Regulariser(drop=0.3), toy_dataset, ITERATIONS, 0)
    lens = toy_dataset.train[0].lens
    plain = usual.renderer().shapes(usual.gaussians, lens).opacities.detach()
    drawn = torch.stack(
        [training.renderer().shapes(training.gaussians, lens).opacities.detach() for _ in range(200)]
    )
    assert (drawn == 0).float().mean() == pytest.approx(0.3, abs=0.01)
    stays = drawn[0] > 0
    assert torch.allclose(drawn[0][stays], (plain[stays] / 0.7).clamp_max(1))


def test_a_background_makes_a_scene_more_opaque(toy_dataset, usual):
    before = trained(toy_dataset, Regulariser(background=1.0))

    def alpha(training) -> float:
        renderer = Training(**vars(usual)).renderer()
        with torch.no_grad():
            return float(renderer(training.gaussians, toy_dataset.train[0].lens, degree=0).alpha.mean())

    assert alpha(before) > alpha(usual)


def test_only_gaussians_nearer_than_was_said_are_slow(toy_dataset, usual):
    none, many = (trained(toy_dataset, Regulariser(slow=slow)) for slow in (1e-3, 1.0))
    means = usual.gaussians.parameters["means"]
    assert torch.equal(none.gaussians.parameters["means"], means)
    assert not torch.equal(many.gaussians.parameters["means"], means)
