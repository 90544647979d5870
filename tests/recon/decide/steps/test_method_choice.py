"""Model of a session, chosen before training, from its calibration alone."""

from dataclasses import replace

import numpy as np
import pytest

from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.decide.steps.method_choice import chosen_method, rungs, uncoloured
from recon.methods import vanilla
from recon.observe.calibrated_curves import Curves, tone_curve
from recon.observe.tone_grid import EXACT, curve_values, grid_nodes, sampled


@pytest.fixture(scope="module")
def photographs(toy_ldr):
    """With a curve whose residual calibration told."""
    return with_residual(load(toy_ldr), 0.03)


def with_residual(dataset, residual):
    """The same session with another residual of its response; None: a guess."""

    def of(view):
        response = view.sensor.response.model_copy(update={"residual": residual})
        return replace(view, sensor=replace(view.sensor, response=response))

    train, held_out = (tuple(map(of, views)) for views in (dataset.train, dataset.held_out))
    return replace(dataset, train=train, held_out=held_out)


def test_a_measured_curve_gets_the_nodes_that_hold_it(photographs):
    measured = Curves.of(photographs)
    assert measured.measured
    (rung,) = (one for one in rungs(photographs, "hdr-gs") if one.name == "tone grid")
    assert not rung.taken
    assert rung.parameters == 3 * len(measured.responses) * len(measured.nodes)
    assert f"{len(measured.nodes)} of {measured.finest:,} nodes" in rung.reason
    assert len(measured.nodes) < 0.1 * measured.finest
    images = [radiance_image(view) for view in photographs.train]
    curve = tone_curve(photographs, light_of(photographs, images))
    finest = grid_nodes()
    (response,) = measured.responses
    true = curve_values(sampled(response, finest, measured.rate, measured.middle)).numpy()
    for channel, values in enumerate(curve.curves()[0].numpy()):
        held = np.interp(finest, curve.nodes.numpy(), values)
        assert np.abs(held - true[channel]).max() < 1.05 * EXACT


def test_a_curve_that_was_not_measured_keeps_every_node(photographs):
    guess = with_residual(photographs, None)
    (rung,) = (one for one in rungs(guess, "hdr-gs") if one.name == "tone grid")
    assert rung.taken
    assert len(Curves.of(guess).nodes) == len(grid_nodes())


def test_no_grid_where_no_curve_is_learned(photographs, toy_dataset):
    assert chosen_method(photographs)[0] == "hdr-gs"
    assert chosen_method(toy_dataset)[0] == "nh-3dgs"
    assert "tone grid" not in {one.name for one in rungs(photographs, "vanilla")}
    assert "tone grid" not in {one.name for one in rungs(toy_dataset, "nh-3dgs")}


def single(photographs, k, *, exposure=1.0, gains=(1.0, 1.0)):
    """The first shot of each view, developed so, by two cameras of these scales and gains in turn."""
    record, names = photographs.calibration, ("cam0", "cam1")
    cameras = tuple(
        record.cameras[0].model_copy(update={"name": name, "gain": gain})
        for name, gain in zip(names, gains, strict=True)
    )
    views = tuple(view.model_copy(update={"exposure": exposure}) for view in record.views)
    guessed = with_residual(photographs, None)
    return replace(
        guessed,
        held_out=(),
        train=tuple(
            replace(view, camera=names[number % 2], shots=(replace(view.shots[0], k=k[number % 2]),))
            for number, view in enumerate(guessed.train)
        ),
        calibration=record.model_copy(update={"views": views, "cameras": cameras}),
    )


@pytest.mark.parametrize(("k", "method"), [((1.0, 1.3), "vanilla"), ((1.0, 5.0), "hdr-gs")])
def test_photographs_exposed_one_by_one_get_a_curve_where_they_show_more_light_than_one_does(
    photographs, k, method
):
    chosen, (rung,) = chosen_method(single(photographs, k, exposure=1.2))
    assert chosen == method
    assert rung.taken == (method == "hdr-gs")
    assert "photographs differ in exposure" in rung.reason


def test_sensitivities_of_cameras_count_as_exposures_do(photographs):
    assert chosen_method(single(photographs, (1.0, 1.0), gains=(0.5, 2.0)))[0] == "hdr-gs"
    assert chosen_method(single(photographs, (1.0, 1.0), gains=(0.9, 1.1)))[0] == "vanilla"


@pytest.mark.parametrize(
    ("session", "knows"),
    [
        ({"k": (1.0, 1.0)}, False),
        ({"k": (1.0, 1.7)}, True),
        ({"k": (1.0, 1.0), "gains": (0.9, 1.1)}, True),
        ({"k": (1.0, 1.0), "exposure": 1.2}, True),
    ],
)
def test_display_values_are_compared_through_what_makes_photographs_differ(photographs, session, knows):
    """Photographs of a camera that exposes by itself differ in brightness, which is none of the scene's."""
    alone = single(photographs, **session)
    light = light_of(alone, [radiance_image(view) for view in alone.train])
    assert vanilla.compose(alone, light).observation.developed == knows
    bracketed = vanilla.compose(photographs, light).observation
    assert not bracketed.developed


def test_raw_without_a_matrix_is_said_to_stay_camera_rgb(toy_dataset):
    def rung(dataset):
        (one,) = (one for one in rungs(dataset, "nh-3dgs") if one.name == "camera colour")
        return one

    cameras = toy_dataset.calibration.cameras
    assert uncoloured(toy_dataset) == []
    assert rung(toy_dataset).taken
    bare = tuple(camera.model_copy(update={"camera_from_rec709": None}) for camera in cameras)
    without = replace(toy_dataset, calibration=toy_dataset.calibration.model_copy(update={"cameras": bare}))
    assert uncoloured(without) == list(dict.fromkeys(view.camera for view in without.views))
    assert not rung(without).taken
    assert "stays camera RGB" in rung(without).reason


def test_cameras_without_a_colour_filter_have_no_colour_to_know(toy_dataset):
    def grey(view):
        sensor = view.sensor
        return replace(view, sensor=replace(sensor, camera_from_rec709=sensor.camera_from_rec709[:1]))

    bare = tuple(
        camera.model_copy(update={"camera_from_rec709": None}) for camera in toy_dataset.calibration.cameras
    )
    mono = replace(
        toy_dataset,
        train=tuple(map(grey, toy_dataset.train)),
        held_out=tuple(map(grey, toy_dataset.held_out)),
        calibration=toy_dataset.calibration.model_copy(update={"cameras": bare}),
    )
    assert uncoloured(mono) == []
    assert not [one for one in rungs(mono, "nh-3dgs") if one.name == "camera colour"]
