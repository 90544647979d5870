"""Figures of held-out views by hand: of EXR behind a lens with falloff, and of views that masks hide."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from imaging import metrics
from imaging.session.records import Band
from recon.data.light import radiance_image
from recon.data.load import load
from recon.measure import view_figures as module
from recon.measure.truth import true_radiance
from recon.measure.view_figures import has_figure, measured, reference_light
from recon.observe.linear import LinearLight
from tests.recon.methods.conftest import as_exr


def opened(dataset, light):
    """A scene of that light, by view, as a method for linear light has it."""
    images = {id(view.lens): torch.from_numpy(light(view)) for view in dataset.views}
    method = SimpleNamespace(observation=LinearLight(1.0))
    return SimpleNamespace(
        dataset=dataset,
        render=lambda lens: images[id(lens)],
        training=SimpleNamespace(method=method),
    )


def true(toy):
    """The true light of a view."""
    return lambda view: true_radiance(toy, view)


def behind_lens(view):
    """The view by a camera of more gain and with falloff: its file has both."""
    falloff = np.linspace(1.3, 0.4, view.lens.width * view.lens.height, dtype=np.float32)
    falloff = falloff.reshape(view.lens.height, view.lens.width)
    shots = tuple(shot.showing(pixels=shot.pixels * falloff[..., None]) for shot in view.shots)
    return replace(view, sensor=replace(view.sensor, falloff=falloff), shots=shots)


def masked(view):
    """The view behind masks that hide all of it."""
    shots = tuple(shot.showing(valid=np.zeros_like(shot.valid)) for shot in view.shots)
    return replace(view, shots=shots)


@pytest.fixture(scope="module")
def exr(toy, tmp_path_factory):
    """The light of the toy session as EXR of cam0, which is held out, and of both."""
    folder = tmp_path_factory.mktemp("exr")
    sessions = [
        as_exr(toy, folder / name, lambda light: light, of=cameras)
        for name, cameras in (("mixed", ["cam0"]), ("hdr", ["cam0", "cam1"]))
    ]
    datasets = []
    for session in sessions:
        (session / "truth" / "truth.json").unlink()
        dataset = load(session)
        views = tuple(behind_lens(view) for view in dataset.views if view.sensor.kind == "hdr")
        datasets.append(replace(dataset, held_out=views))
    return datasets


def test_light_of_exr_is_that_before_the_lens(exr, toy):
    dataset = exr[1]
    assert dataset.kind == "hdr"
    for view, light in zip(dataset.held_out, reference_light(opened(dataset, true(toy))), strict=True):
        np.testing.assert_allclose(light, true_radiance(toy, view), rtol=1e-5)
        np.testing.assert_allclose(light, radiance_image(view)[0], rtol=1e-5)


def test_exr_views_of_a_mixed_rig_have_a_figure(exr, toy):
    """They are held against one peak, whatever lens they were behind; a masked one is left out."""
    dataset = exr[0]
    first, *others = dataset.held_out
    dataset = replace(dataset, held_out=(masked(first), *others))
    assert dataset.kind == "mixed"
    _, _, rows, _ = measured(opened(dataset, true(toy)))
    assert "hdr_psnr_mu" not in rows[0]
    assert all(row["hdr_psnr_mu"] > 100 for row in rows[1:])
    assert [has_figure(dataset, view) for view in dataset.held_out] == [False, *[True] * len(others)]

    _, _, rows, _ = measured(opened(dataset, lambda view: 2 * true_radiance(toy, view)))
    light = [true_radiance(toy, view) for view in others]
    peak = max(float(goal.max()) for goal in light)
    expected = [metrics.hdr_psnr_mu(2 * goal, goal, peak) for goal in light]
    assert [row["hdr_psnr_mu"] for row in rows[1:]] == pytest.approx(expected, abs=1e-3)


def test_photographs_have_a_figure_at_exposures_that_training_saw(toy_dataset):
    """Without a truth, which has a figure for all."""
    view = toy_dataset.held_out[0]
    photographs = replace(view, sensor=replace(view.sensor, kind="ldr"))
    elsewhere = replace(photographs, shots=tuple(replace(shot, k=shot.k * 1.4) for shot in view.shots))
    views = [view, photographs, elsewhere]
    dataset = replace(toy_dataset, session=toy_dataset.session / "raw")
    assert [has_figure(dataset, view) for view in views] == [True, True, False]
    assert [has_figure(toy_dataset, view) for view in views] == [True, True, True]


def test_a_view_that_is_masked_altogether_has_no_figures(toy, toy_dataset):
    held_out = (masked(toy_dataset.held_out[0]), toy_dataset.train[0])
    dataset = replace(toy_dataset, train=toy_dataset.train[1:], held_out=held_out)
    _, _, rows, pooled = measured(opened(dataset, true(toy)))
    assert rows[0].keys() == {"view"}
    assert rows[1].keys() > {"hdr_psnr_mu", "hdr_psnr_mu_aligned", "raw_psnr"}
    assert rows[1]["hdr_psnr_mu"] > 100
    assert pooled["alignment_scale"] == pytest.approx(1.0)


@pytest.mark.parametrize("bands", [(), (Band(name="a"),)])
def test_where_masks_hide_all_held_out_views_nothing_is_pooled(toy, toy_dataset, monkeypatch, bands):
    monkeypatch.setattr(module, "true_radiance", lambda session, view, bands: true_radiance(session, view))
    held_out = tuple(masked(view) for view in toy_dataset.held_out)
    _, _, rows, pooled = measured(opened(replace(toy_dataset, held_out=held_out, bands=bands), true(toy)))
    assert rows == [{"view": view.name} for view in held_out]
    assert pooled == {}
