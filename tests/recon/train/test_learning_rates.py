"""Learning rates by the length of a training."""

import numpy as np
import pytest
import torch

from recon.decide import trials
from recon.decide.settings import Settings
from recon.observe.refinement import RATES, Refinement
from recon.scene.environment import NAME as ENVIRONMENT
from recon.scene.environment import RATE, Environment
from recon.train.densification import DensityRules
from recon.train.devices.ranks import Ranks
from recon.train.schedule import USUAL, rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training
from tests.recon.beginning import beginning

CAP = 400


@pytest.fixture(scope="module")
def begun(toy_dataset):
    """A function that makes a new training on the toy session, always the same."""
    return beginning(toy_dataset, CAP // 2)


def run(training, dataset, plan, until=None):
    train(training, dataset, plan, until=until)
    return training


def test_the_shorter_the_training_the_larger_its_steps():
    assert rate_factor(USUAL) == 1
    factors = [rate_factor(n) for n in (1, 50, 300, 4000, 10**6)]
    assert factors == sorted(factors, reverse=True)
    assert 2 < rate_factor(300) < 2.3
    assert np.isfinite(factors).all()


def test_a_whole_training_has_the_rates_of_its_length_over_all_that_share_it():
    given = {"method": "nh-3dgs", "quality": "draft", "seed": 3, "max_gaussians": 500, "max_width": 64}
    one, two = (
        Settings.model_validate(given | {"iterations": n, "batch": b}).plan() for n, b in ((300, 1), (150, 2))
    )
    assert one.rate_factor == two.rate_factor == rate_factor(300)
    assert (one.iterations, one.density, one.seed, one.measure) == (300, DensityRules(500), 3, True)


def test_a_trial_has_the_rates_of_its_length(toy_dataset, monkeypatch):
    plans = []
    monkeypatch.setattr(trials, "train", lambda training, dataset, plan, hooks: plans.append(plan))
    settings = Settings.model_validate(
        {"method": "nh-3dgs", "quality": "draft", "seed": 3, "max_gaussians": 500, "max_width": 64}
        | {"iterations": 2000}
    )
    some = trials.Trials.from_new_points(toy_dataset, settings, 50, lambda message, done, total: None)
    some.trained(40, 100, "a trial")
    assert plans == [Plan(40, DensityRules(100), 3, rate_factor=rate_factor(40))]


def test_everything_moves_faster_but_for_corrections(begun, toy_dataset):
    rates = []
    for factor in (1.0, 3.0):
        training = begun(refinement=Refinement.of(toy_dataset, ["poses", "exposures"]))
        run(training, toy_dataset, Plan(100, DensityRules(CAP), rate_factor=factor), until=1)
        rates.append({group["name"]: group["lr"] for group in training.optimizer.param_groups})
    for name, usual in rates[0].items():
        assert rates[1][name] == pytest.approx(usual if name in RATES else 3 * usual)
    assert set(RATES) & set(rates[0]) == {"poses", "exposures"}


def test_light_from_far_away_moves_no_further_in_a_longer_training(begun, toy_dataset):
    """A texel is in few views; more steps of the same size would fit their noise."""
    far = Environment(torch.zeros(3, 8, 16), np.eye(3))
    rates = {}
    for iterations in (100, 300, 3000):
        training = begun()
        training = Training.begin(
            training.method, training.light, training.gaussians, 1.0, environment=far.copied()
        )
        plan = Plan(iterations, DensityRules(CAP), rate_factor=rate_factor(iterations))
        run(training, toy_dataset, plan, until=1)
        lr = {group["name"]: group["lr"] for group in training.optimizer.param_groups}
        rates[iterations] = lr[ENVIRONMENT] / plan.rate_factor
        assert lr["opacity_logits"] / plan.rate_factor == pytest.approx(1e-1, rel=0.1)
    assert rates[100] == pytest.approx(RATE.start, rel=0.05)
    assert rates[300] == pytest.approx(RATE.start, rel=0.02)
    assert 3000 * rates[3000] * rate_factor(3000) == pytest.approx(
        300 * rates[300] * rate_factor(300), rel=0.05
    )


def test_a_short_training_gets_further_at_the_rates_of_its_length(begun, toy_dataset):
    """Require more than 1 dB of held-out views, in 40 iterations."""
    usual, short = (
        run(begun(), toy_dataset, Plan(40, DensityRules(CAP), rate_factor=factor))
        for factor in (1.0, rate_factor(40))
    )
    psnrs = [training.held_out_psnr(toy_dataset.held_out, 1.0, Ranks()) for training in (usual, short)]
    assert psnrs[1] > psnrs[0] + 1.0
