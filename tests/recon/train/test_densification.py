"""Density control: what it may never break."""

import numpy as np
import pytest
import torch

from recon.data.light import Light
from recon.methods.method import Method
from recon.observe.linear import LinearLight
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.gaussians import GEOMETRY, Gaussians
from recon.splat import SplatStats
from recon.train.densification import Density, DensityRules, rotate
from recon.train.training import Training

COUNT = 40


def make_training() -> Training:
    generator = torch.Generator().manual_seed(0)
    appearance = LuminanceChromaticity()
    gaussians = Gaussians(
        {
            "means": torch.randn(COUNT, 3, generator=generator),
            "log_scales": torch.randn(COUNT, 3, generator=generator) - 2,
            "quats": torch.randn(COUNT, 4, generator=generator),
            "opacity_logits": torch.randn(COUNT, generator=generator) + 1,
            **appearance.start(torch.rand(COUNT, 3, generator=generator)),
        }
    )
    training = Training.begin(
        Method("test", appearance, LinearLight(1.0)), Light(1.0, 1e-3), gaussians, extent=1.0
    )
    loss = sum((value**2).sum() for value in gaussians.parameters.values())
    loss.backward()
    training.optimizer.step()
    return training


def make_stats(seed: int = 1) -> SplatStats:
    rng = np.random.default_rng(seed)
    stats = SplatStats(COUNT)
    stats.tension[:] = torch.from_numpy(rng.uniform(0, 1, COUNT))
    return stats


def adapt(training: Training, stats: SplatStats, rules: DensityRules, reference=1e-3, progress=0.3):
    luminance = training.method.appearance.luminance(training.gaussians.parameters)
    generator = torch.Generator().manual_seed(9)
    change = Density(rules, reference).adapt(training.gaussians, luminance, stats, progress, generator)
    change.apply(training.gaussians, training.optimizer)
    return change


def test_growth_never_passes_the_cap_and_reaches_it():
    for cap in (COUNT, COUNT + 1, COUNT + 7, 200):
        training = make_training()
        rules = DensityRules(cap, every=0.05)
        for progress in np.arange(0.05, 0.61, 0.05):
            stats = SplatStats(len(training.gaussians))
            stats.tension[:] = 1
            adapt(training, stats, rules, progress=float(progress))
            assert len(training.gaussians) <= cap
        assert len(training.gaussians) == cap


def test_every_parameter_and_every_memory_stays_in_step():
    training = make_training()
    before = {name: value.detach().clone() for name, value in training.gaussians.parameters.items()}
    memory = {
        group["name"]: training.optimizer.state[group["params"][0]]["exp_avg"].clone()
        for group in training.optimizer.param_groups
    }
    change = adapt(training, make_stats(), DensityRules(COUNT + 6))
    staying = int(change.keep.sum())
    born = len(change.new["means"])
    assert born == 2 * (COUNT - staying) > 0
    for group in training.optimizer.param_groups:
        name, (value,) = group["name"], group["params"]
        assert value is training.gaussians.parameters[name]
        assert value.requires_grad
        assert len(value) == staying + born
        assert torch.equal(value.detach()[:staying], before[name][change.keep])
        state = training.optimizer.state[value]
        assert torch.equal(state["exp_avg"][:staying], memory[name][change.keep])
        assert state["exp_avg"][staying:].eq(0).all()
        assert state["exp_avg_sq"].shape == value.shape
    assert len(training.optimizer.state) == len(training.optimizer.param_groups)
    sum((value**2).sum() for value in training.gaussians.parameters.values()).backward()
    training.optimizer.step()


def test_the_steepest_are_split_into_smaller_ones_that_let_as_much_light_through():
    training = make_training()
    old = training.gaussians.rows(torch.arange(COUNT))
    stats = make_stats()
    change = adapt(training, stats, DensityRules(COUNT + 4, growth=0.1, begin=0.0, end=0.0))
    split = torch.nonzero(~change.keep)[:, 0]
    steepest = np.sort(np.argsort(-stats.tension.numpy())[: len(split)])
    np.testing.assert_array_equal(split, steepest)
    for half in (slice(0, len(split)), slice(len(split), None)):
        child = {name: value[half] for name, value in change.new.items()}
        np.testing.assert_allclose(child["log_scales"], old["log_scales"][split] - np.log(1.6), rtol=1e-5)
        through = (1 - torch.sigmoid(child["opacity_logits"])) ** 2
        np.testing.assert_allclose(through, 1 - torch.sigmoid(old["opacity_logits"][split]), atol=1e-5)
        offset = rotate(
            old["quats"][split] * torch.tensor([1, -1, -1, -1.0]), child["means"] - old["means"][split]
        )
        assert (offset.abs() < 6 * old["log_scales"][split].exp()).all()
        for name in set(old) - {"means", "log_scales", "opacity_logits"}:
            assert torch.equal(child[name], old[name][split])


def test_a_share_at_most_is_split_at_once_and_the_cap_is_reached_in_even_steps():
    change = adapt(make_training(), make_stats(), DensityRules(10 * COUNT, growth=0.1, begin=0.0, end=0.0))
    assert int((~change.keep).sum()) == np.ceil(0.1 * COUNT)
    rules = DensityRules(COUNT + 20, growth=1.0, begin=0.0, end=1.0, every=0.125)  # eight adaptations
    assert int((~adapt(make_training(), make_stats(), rules, progress=0.0).keep).sum()) == 3
    assert int((~adapt(make_training(), make_stats(), rules, progress=0.75).keep).sum()) == 10


def test_the_two_of_a_split_lie_apart_as_the_one_was_wide():
    training = make_training()
    old = training.gaussians.rows(torch.arange(COUNT))
    change = adapt(training, make_stats(), DensityRules(2 * COUNT, growth=1.0, begin=0.0, end=0.0))
    split = torch.nonzero(~change.keep)[:, 0]
    assert len(split) == COUNT
    halves = [change.new["means"][:COUNT], change.new["means"][COUNT:]]
    back = old["quats"] * torch.tensor([1, -1, -1, -1.0])
    apart = [rotate(back, half - old["means"]) / old["log_scales"].exp() for half in halves]
    assert torch.stack(apart).std().item() == pytest.approx(1.0, abs=0.2)
    assert ((halves[0] - halves[1]).norm(dim=1) > 0).all()


def test_faint_dim_ones_go_and_faint_bright_ones_stay():
    training = make_training()
    with torch.no_grad():
        training.gaussians.parameters["opacity_logits"][:3] = float(np.log(0.005 / 0.995))
        training.gaussians.parameters["ln_luminance"][:3] = torch.tensor([1e-4, 1e-3, 1.0]).log()
    change = adapt(training, make_stats(), DensityRules(COUNT - 2))
    assert change.keep[:3].tolist() == [False, False, True]
    assert change.keep[3:].all()


def test_broken_ones_go():
    training = make_training()
    with torch.no_grad():
        training.gaussians.parameters["means"][5, 1] = float("nan")
        training.gaussians.parameters["log_scales"][6, 0] = float("inf")
    change = adapt(training, make_stats(), DensityRules(COUNT - 2))
    assert torch.nonzero(~change.keep)[:, 0].tolist() == [5, 6]


def test_where_all_are_invisible_the_most_opaque_one_stays():
    """Use a black scene; a broken Gaussian does not stay, however opaque."""
    training = make_training()
    with torch.no_grad():
        training.gaussians.parameters["ln_luminance"][:] = -20.0
        training.gaussians.parameters["opacity_logits"][:] = -9.0
        training.gaussians.parameters["opacity_logits"][7] = -8.0
        training.gaussians.parameters["opacity_logits"][3] = 9.0
        training.gaussians.parameters["means"][3] = float("nan")
    stats = make_stats()
    stats.tension[:] = 0.0
    change = adapt(training, stats, DensityRules(COUNT))
    assert torch.nonzero(change.keep)[:, 0].tolist() == [7]
    assert len(training.gaussians) == 1


def test_the_same_seed_adapts_alike():
    first, second = make_training(), make_training()
    for training in (first, second):
        adapt(training, make_stats(), DensityRules(COUNT + 10))
    for name in (*GEOMETRY, "ln_luminance"):
        assert torch.equal(first.gaussians.parameters[name], second.gaussians.parameters[name])


def test_when_it_is_due():
    density = Density(DensityRules(10, begin=0.1, end=0.5, every=0.1), None)
    assert [i for i in range(1, 101) if density.due(i, 100)] == [10, 20, 30, 40, 50]
    assert [i for i in range(1, 4) if density.due(i, 3)] == [1]


def test_rotation_by_a_quaternion_of_any_length():
    half = np.sqrt(0.5)
    quarter_turn = torch.tensor([[3 * half, 0, 0, 3 * half]], dtype=torch.float32)
    np.testing.assert_allclose(rotate(quarter_turn, torch.tensor([[1.0, 0, 2]])), [[0, 1, 2]], atol=1e-6)
