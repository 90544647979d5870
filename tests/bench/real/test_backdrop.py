"""A map behind the Gaussians is as coarse as it is called, and fixed where it is called so."""

import numpy as np
import pytest

from bench.real.backdrop import CANDIDATES, COARSE, Given, begun, gains
from bench.support import oracle
from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.decide.presets import QUALITIES
from recon.methods import METHODS
from recon.start.initialisation import start_points
from recon.train.densification import DensityRules
from recon.train.trainer import train
from recon.train.training import Plan


@pytest.fixture(scope="module")
def given(made_once):
    dataset = load(
        made_once("recon-toy-ldr", lambda folder: oracle.oracle_session(folder, "toy-ldr", points=300))
    )
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    start = start_points(dataset, images, 200, np.random.Generator(np.random.PCG64(0)))
    return Given(dataset, images, light, METHODS["vanilla"](dataset, light), start, QUALITIES["draft"])


@pytest.mark.parametrize(("name", "least", "most"), [("trained", 0.01, 3.0), ("fixed", 0.0, 1e-6)])
def test_a_coarse_map_moves_as_fast_as_it_is_called(given, name, least, most):
    training = begun(given, CANDIDATES[f"coarse map, {name}"][0])
    before = training.environment.ln_light.detach().clone()
    assert before.shape == (3, COARSE, 2 * COARSE)
    assert len(training.gaussians) == len(given.start.xyz)
    train(training, given.dataset, Plan(10, DensityRules(200)))
    moved = float((training.environment.ln_light.detach() - before).abs().max())
    assert least <= moved <= most


def test_a_gain_is_over_the_usual_training_of_the_same_fold_and_view():
    def row(candidate, fold, quality="draft", **db):
        views = {view: {"gained": of, "seen": of, "unseen": of, "ssim": of / 100} for view, of in db.items()}
        return {"candidate": candidate, "quality": quality, "set": "castle", "fold": fold, "views": views}

    rows = [
        row("usual", 0, a=10.0, b=20.0),
        row("usual", 1, c=30.0),
        row("coarse map, fixed", 0, b=21.0, a=12.0),
        row("usual", 0, "standard", a=11.0),
        row("coarse map, fixed", 0, "standard", a=16.0),
    ]
    gain = gains({"rows": rows}, "draft", "coarse map, fixed", "castle")
    assert sorted(gain[:, 0]) == [1.0, 2.0]
    assert sorted(gain[:, 3].round(9)) == [0.01, 0.02]
    assert gains({"rows": rows}, "standard", "coarse map, fixed", "castle")[:, 0] == [5.0]
    assert gains({"rows": rows}, "draft", "coarse map, fixed", "banana").shape == (0, 4)
