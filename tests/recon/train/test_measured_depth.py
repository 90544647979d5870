"""Training with depth that was measured: surfaces are where it says, and masks and alpha have their say."""

import numpy as np
import pytest
import torch

from bench.support.depths import true_depth
from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.data.measured_depth import fit
from recon.decide.settings import Settings
from recon.start.initialisation import gaussians_at, start_points
from recon.train.trainer import train
from recon.train.training import Training


@pytest.fixture(scope="module")
def dataset(toy_deep):
    loaded = load(toy_deep)
    fitted = fit(loaded.train, *loaded.tracks())
    assert fitted.fits
    return loaded.with_depths(fitted.scale)


def trained(dataset, start, light, weight: float) -> Training:
    settings = Settings(
        method="nh-3dgs", quality="draft", seed=0, iterations=60, max_gaussians=900, max_width=64,
        depth=weight,
    )  # fmt: skip
    method = settings.composed(dataset, light)
    gaussians = gaussians_at(start, method.appearance, method.observation.units)
    training = Training.begin(method, light, gaussians, dataset.extent)
    train(training, dataset, settings.plan())
    return training


def error(dataset, training) -> float:
    """Median over held-out pixels of how far the rendered depth is off, ln."""
    off = []
    for view in dataset.held_out:
        with torch.no_grad():
            render = training.renderer()(training.gaussians, view.lens, degree=0, depth=True)
        truth = np.log(true_depth(dataset, view) / dataset.world.unit)
        rendered = (render.ln_depth / render.alpha.clamp_min(1e-6)).numpy()
        off.append(np.abs(rendered - truth)[render.alpha.numpy() > 0.5])
    return float(np.median(np.concatenate(off)))


def test_surfaces_of_views_that_nobody_measured_are_nearer_to_the_truth(dataset):
    without = dataset.with_depths(None)
    images = [radiance_image(view) for view in without.train]
    light = light_of(without, images)
    start = start_points(without, images, 600, np.random.Generator(np.random.PCG64(0)))
    plain, deep = (error(dataset, trained(dataset, start, light, weight)) for weight in (0.0, 0.5))
    assert deep < 0.75 * plain


def test_without_a_weight_or_a_map_the_training_is_as_ever(dataset):
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    start = start_points(dataset, images, 300, np.random.Generator(np.random.PCG64(0)))
    one = trained(dataset, start, light, 0.0)
    other = trained(dataset.with_depths(None), start, light, 0.5)
    for name, value in one.gaussians.parameters.items():
        assert torch.equal(value, other.gaussians.parameters[name])
