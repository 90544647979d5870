"""What is drawn of one scene, and of two: against the scene's own renders."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imaging.session.paths import find_reconstruction
from recon.result.scene import Scene, open_scene
from rig.view.layers import picture_of
from rig.view.meter import reading
from rig.view.painter import DIFFERENCE, FIRST, OVER, REFERENCE, RENDER, SECOND, SPLIT, Painter, Parts, Wanted


@pytest.fixture(scope="module")
def scene(scene_template: Path) -> Scene:
    return open_scene(find_reconstruction(scene_template))


@pytest.fixture(scope="module")
def brighter(scene: Scene) -> Scene:
    """By a stop."""
    return replace(scene, record=scene.record.model_copy(update={"normaliser": 2 * scene.record.normaliser}))


def wanted(painter: Painter, show: str, parts: Parts | None = None) -> Wanted:
    view = next(iter(painter.references))
    return Wanted(show, view, painter.placed(view), parts or Parts())


def test_two_scenes_are_compared_in_stops(scene: Scene, brighter: Scene) -> None:
    painter = Painter(scene, brighter)
    assert painter.shows(None) == (FIRST, SECOND, SPLIT, OVER)
    first, second, split, over = (painter.draw(wanted(painter, show)) for show in painter.shows(None))
    np.testing.assert_allclose(second.light, 2 * first.light, rtol=1e-5)
    middle = first.light.shape[1] // 2
    np.testing.assert_array_equal(split.light[:, :middle], first.light[:, :middle])
    np.testing.assert_array_equal(split.light[:, middle:], second.light[:, middle:])
    np.testing.assert_allclose(over.light, 2 * over.over, rtol=1e-5)
    assert "**+1.000 stops** over what it is compared with" in reading(over, OVER, scene, 10, 12)


def test_a_render_lies_beside_its_reference(scene: Scene) -> None:
    painter = Painter(scene)
    view = next(iter(painter.references))
    assert painter.shows(view)[:3] == (RENDER, REFERENCE, DIFFERENCE)
    assert REFERENCE not in painter.shows(None)
    difference, reference = (painter.draw(wanted(painter, show)) for show in (DIFFERENCE, REFERENCE))
    np.testing.assert_allclose(difference.light, scene.render(view), rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(difference.over, reference.light, rtol=1e-5)


def test_parts_of_the_model_are_left_out(scene: Scene) -> None:
    """Colours of degree 0 are those of a scene that was trained with no more."""
    higher = replace(scene, record=scene.record.model_copy(update={"degree": 2}))
    generator = np.random.default_rng(4)
    parameters = dict(higher.gaussians.parameters)
    rest = parameters["chroma_rest"]
    parameters["chroma_rest"] = rest + rest.new_tensor(generator.normal(0, 1, rest.shape))
    higher = replace(higher, gaussians=replace(higher.gaussians, parameters=parameters))
    painter, plain = (
        Painter(higher),
        Painter(replace(scene, record=higher.record.model_copy(update={"degree": 0}))),
    )
    full, none = (painter.draw(wanted(painter, RENDER, parts)).light for parts in (Parts(), Parts(degree=0)))
    assert np.abs(np.log(full / none)).max() > 0.1
    np.testing.assert_array_equal(none, plain.draw(wanted(plain, RENDER)).light)


def test_what_there_is_nothing_of_is_black(scene: Scene) -> None:
    nothing = np.array([[np.inf, scene.record.world.unit]], np.float32)
    shown = picture_of("depth", nothing, scene)
    assert shown[0, 0].tolist() == [0, 0, 0]
    assert shown[0, 1].max() > 100
    normal = np.array([[[0, 0, 0], [0, 0, 1]]], np.float32)
    assert picture_of("normal", normal, scene)[0].tolist() == [[0, 0, 0], [128, 128, 255]]
    assert picture_of("trust", np.zeros((1, 1), np.float32), scene).tolist() == [[[0, 0, 0]]]
