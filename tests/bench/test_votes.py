"""The votes of photographs on a Gaussian against renders from which it was taken."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from bench.floaters.votes import evidence
from bench.support import oracle
from recon.data.light import radiance_image
from recon.data.load import load
from recon.scene.gaussians import Gaussians
from recon.train.densification import DensityRules
from recon.train.trainer import train
from recon.train.training import Plan
from tests.recon.beginning import beginning


@pytest.fixture(scope="module")
def trained(made_once):
    """A short training on the toy session, and its data set."""
    dataset = load(made_once("recon-toy", lambda folder: oracle.oracle_session(folder, "toy", points=300)))
    training = beginning(dataset, 150)()
    train(training, dataset, Plan(60, DensityRules(200)))
    return training, dataset


class Light:
    """Compares light as it is, which a Gaussian changes by what it adds and by nothing else."""

    display_values = False

    def __init__(self, training, dataset):
        self.of = {view.name: torch.from_numpy(radiance_image(view)[0]) for view in dataset.train}
        self.normaliser = training.light.normaliser

    def compare(self, image, view, progress, factors=None):
        return image.movedim(2, 0), (self.of[view.name] / self.normaliser).movedim(2, 0)


def chi_square(training, gaussians, view, variance=None):
    """Chi-square of a view, in units of the mean squared error of all Gaussians."""
    with torch.no_grad():
        image = training.renderer()(gaussians, view.lens, degree=training.method.degree(1.0)).image
        prediction, target = training.method.observation.compare(image, view, 1.0)
    missed = (prediction - target).double().square()
    variance = missed.sum() / (missed != 0).sum() if variance is None else variance
    return float(missed.sum() / variance), variance


def test_what_chi_square_gains_is_what_it_gains_when_a_gaussian_is_taken_away(trained):
    training, dataset = trained
    method = replace(training.method, observation=Light(training, dataset))
    training = replace(training, method=method)
    gaussians, gains, predicted = training.gaussians, [], []
    for view in dataset.train[:2]:
        votes = evidence(training, [view], 1.0, seed=0, probes=64)
        whole, variance = chi_square(training, gaussians, view)
        for victim in range(len(gaussians)):
            others = torch.arange(len(gaussians)) != victim
            without, _ = chi_square(training, Gaussians(gaussians.rows(others)), view, variance)
            gains.append(without - whole)
        predicted.append(votes.total.numpy())
    gains, predicted = np.array(gains), np.concatenate(predicted)
    part = np.abs(gains) > 1
    assert part.sum() > 20
    assert np.corrcoef(gains[part], predicted[part])[0, 1] > 0.95
    clear = part & (np.abs(gains) > 20)
    assert clear.sum() > 10
    assert (np.sign(gains[clear]) == np.sign(predicted[clear])).mean() > 0.95


def test_what_no_view_shows_has_no_votes(trained):
    training, dataset = trained
    hidden = training.gaussians.rows(torch.arange(3))
    hidden["means"] += 1e4
    visible = training.gaussians
    training.gaussians = visible.joined(Gaussians(hidden))
    try:
        cast = evidence(training, dataset.train, 1.0, seed=0)
        nothing = evidence(training, (), 1.0, seed=0)
    finally:
        training.gaussians = visible
    for votes in (cast.visible, cast.needed, cast.opposed, cast.total):
        assert torch.isfinite(votes.double()).all()
        assert not votes[-3:].any()
    assert cast.needed[:-3].any()
    assert not nothing.visible.any()
