"""A toy session of fisheyes trains: what is seen far from the axis is learned as what is near."""

import numpy as np
import pytest
import torch

from bench.support import oracle
from imaging import metrics
from recon.data.dataset import Dataset
from recon.data.load import load
from recon.measure.truth import true_radiance
from recon.train.densification import DensityRules
from recon.train.trainer import train
from recon.train.training import Plan
from tests.recon.beginning import beginning


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Dataset:
    return load(oracle.oracle_session(tmp_path_factory.mktemp("wide") / "toy", "toy-fisheye", points=300))


def test_a_session_of_fisheyes_is_learned_up_to_the_corners(dataset):
    assert all(view.lens.fisheye for view in dataset.views)
    training = beginning(dataset, 600)()
    (view,) = dataset.held_out
    truth = true_radiance(dataset.session, view)
    y, x = np.mgrid[0 : view.lens.height, 0 : view.lens.width] + 0.5
    far = np.hypot(x - view.lens.cx, y - view.lens.cy) / view.lens.fx > 0.7  # radians, about

    def quality() -> tuple[float, float]:
        """mu-law PSNR, dB, and the median error in stops where the angle from the axis is above 0.7."""
        with torch.no_grad():
            image = training.renderer()(training.gaussians, view.lens, degree=2).image
        learned = training.method.observation.radiance(image).numpy()
        return metrics.hdr_psnr_mu(learned, truth), metrics.stops_median(learned[far][None], truth[far][None])

    before, _ = quality()
    plan = Plan(150, DensityRules(900), log_every=50)
    train(training, dataset, plan)
    after, stops = quality()
    assert 100 < far.sum() < far.size / 2
    assert all(torch.isfinite(tensor).all() for tensor in training.parameters())
    assert after > before + 3
    assert after > 28
    assert stops < 0.3
