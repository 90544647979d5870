"""Drawing of one scene, and of two: against the scene's own renders."""

from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from imaging.session.paths import find_reconstruction
from recon.result.scene import Scene, open_scene
from rig.terminal.text import number
from rig.view.pages.page import ScenePage
from rig.view.pictures.layers import LAYERS, picture_of
from rig.view.pictures.look import LUMINANCE
from rig.view.pictures.meter import reading
from rig.view.pictures.painter import (
    DIFFERENCE,
    FIRST,
    OVER,
    REFERENCE,
    RENDER,
    SECOND,
    SPLIT,
    Drawing,
    Painter,
    Parts,
    Wanted,
)
from rig.view.pictures.residuals import Residuals, residuals_of


@pytest.fixture(scope="module")
def scene(scene_template: Path) -> Scene:
    return open_scene(find_reconstruction(scene_template))


@pytest.fixture(scope="module")
def brighter(scene: Scene) -> Scene:
    """Multiply by two."""
    return replace(scene, record=scene.record.model_copy(update={"normaliser": 2 * scene.record.normaliser}))


def changed(scene: Scene, **update: object) -> Scene:
    """The scene with other values of its views."""
    views = tuple(view.model_copy(update=update) for view in scene.views)
    return replace(scene, record=scene.record.model_copy(update={"views": views}))


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
    assert "**+1.000 stops** over A" in reading(over, OVER, scene, 10, 12)


def test_a_place_without_light_is_said_to_have_none(scene: Scene) -> None:
    light = np.zeros((2, 2, 3), np.float32)
    light[1, 1] = 1.0
    drawing = Drawing(light)
    residuals = Painter(scene).residuals()
    assert residuals is not None
    for known in (None, residuals):
        dark = reading(drawing, RENDER, scene, 0, 1, known)
        assert dark.startswith("**no light**")
        assert "stops" not in dark
        assert "luminance 0" in dark
    assert "stops** from middle grey" in reading(drawing, RENDER, scene, 1, 1)


def test_a_render_lies_beside_its_reference(scene: Scene) -> None:
    painter = Painter(scene)
    view = next(iter(painter.references))
    assert painter.shows(view)[:3] == (RENDER, REFERENCE, DIFFERENCE)
    assert REFERENCE not in painter.shows(None)
    difference, reference = (painter.draw(wanted(painter, show)) for show in (DIFFERENCE, REFERENCE))
    np.testing.assert_allclose(difference.light, scene.render(view), rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(difference.over, reference.light, rtol=1e-5)


def test_a_view_is_shown_and_measured_as_it_was_held(scene: Scene, brighter: Scene) -> None:
    """The left side of the stored picture is up, also of the second scene, which has no photographs."""
    held, unstated = changed(scene, orientation=6), changed(brighter, shots=())
    for scenes, shows in (
        ((held,), (RENDER, REFERENCE, DIFFERENCE, *LAYERS)),
        ((held, unstated), (SECOND, OVER)),
    ):
        painter, flat = Painter(*scenes), Painter(scene, *scenes[1:])
        for show in shows:
            upright, stored = (one.draw(wanted(one, show)) for one in (painter, flat))
            for name in ("light", "over", "layer"):
                before = getattr(stored, name)
                turned = None if before is None else before[::-1].swapaxes(0, 1)
                np.testing.assert_array_equal(getattr(upright, name), turned)
            height, width = stored.light.shape[:2]
            row, column = 3, width // 3
            lines = reading(stored, show, scene, row, column).split("  \n")
            assert lines[-1] == f"column {column}, row {row} of {width}x{height}"
            lines[-1] = f"column {height - 1 - row}, row {column} of {height}x{width}"
            assert reading(upright, show, held, column, height - 1 - row) == "  \n".join(lines)
    split, first, second = (painter.draw(wanted(painter, show)).light for show in (SPLIT, FIRST, SECOND))
    middle = split.shape[1] // 2
    np.testing.assert_array_equal(split, np.hstack([first[:, :middle], second[:, middle:]]))
    free = replace(wanted(painter, FIRST), view=None)
    np.testing.assert_array_equal(painter.draw(free).light, flat.draw(free).light)


def test_each_scene_is_held_as_its_own_photographs_are_stored(scene: Scene, brighter: Scene) -> None:
    """The second scene has the pictures of the first on their side."""
    painter = Painter(scene, changed(brighter, orientation=6))
    first, second = (painter.draw(wanted(painter, show)).light for show in (FIRST, SECOND))
    np.testing.assert_allclose(second, 2 * first[::-1].swapaxes(0, 1), rtol=1e-5)
    free = replace(wanted(painter, SECOND), view=None)
    assert painter.draw(free).light.shape == first.shape


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


def test_the_spot_meter_has_the_error_at_a_brightness() -> None:
    """Errors are normal, of a size that grows with the light."""
    generator = np.random.default_rng(3)
    brightness = generator.uniform(-6, 6, 200_000).astype(np.float32)
    off = (generator.normal(0, 1, len(brightness)) * np.where(brightness < 0, 0.1, 0.4)).astype(np.float32)
    residuals = Residuals(brightness, off, 3)
    assert residuals.at(2.0**-3) == pytest.approx(0.1, rel=0.03)
    assert residuals.at(2.0**3) == pytest.approx(0.4, rel=0.03)
    assert residuals.at(2.0**20) is None
    assert residuals.at(0.0) is None


def test_a_scene_is_off_held_out_photographs_by_what_it_is_too_bright(scene: Scene) -> None:
    plain = residuals_of(scene)
    brighter = replace(
        scene, record=scene.record.model_copy(update={"normaliser": 16 * scene.record.normaliser})
    )
    residuals = residuals_of(brighter)
    assert residuals.views == len([view for view in scene.views if view.use == "test"])
    np.testing.assert_allclose(residuals.off, plain.off + 4, atol=1e-3)
    assert abs(np.median(plain.off)) < 1
    painter = Painter(scene)
    drawing = painter.draw(wanted(painter, RENDER))
    luminance = drawing.light @ LUMINANCE
    row, column = np.unravel_index(np.argsort(luminance, axis=None)[luminance.size // 2], luminance.shape)
    assert painter.residuals() is painter.residuals()
    text = reading(drawing, RENDER, scene, row, column, painter.residuals())
    assert f"**+- {number(plain.at(float(luminance[row, column])), 2)} stops**" in text


def test_the_error_is_that_of_the_scene_that_is_measured(scene: Scene, brighter: Scene) -> None:
    painter = Painter(scene, brighter)
    view, spot = next(iter(painter.references)), SimpleNamespace(content="")
    page = SimpleNamespace(
        painter=painter,
        controls=SimpleNamespace(spot=spot),
        client=SimpleNamespace(flush=lambda: None),
        _closed=Event(),
    )
    expected = [residuals_of(scene), residuals_of(brighter), None]
    stated = set()
    for show, right, number_of in [
        (FIRST, False, 0),
        (SECOND, False, 1),
        (SPLIT, False, 0),
        (SPLIT, True, 1),
        (OVER, False, 1),
        (REFERENCE, False, 2),
    ]:
        drawing = painter.draw(Wanted(show, view, painter.placed(view)))
        height, width = drawing.light.shape[:2]
        place = height // 2, width // 2 - (not right)
        ScenePage._measure(page, drawing, place, show, coarse=False)
        residuals, luminance = expected[number_of], float(drawing.light[place] @ LUMINANCE)
        error = None if residuals is None else residuals.at(luminance)
        assert spot.content == reading(drawing, show, scene, *place, residuals)
        assert (error is not None) == ("68 % of held-out pixels" in spot.content) == (number_of < 2)
        stated.add(error)
    assert len(stated) > 2


def test_without_its_photographs_a_scene_has_no_error(scene: Scene, tmp_path: Path) -> None:
    assert residuals_of(replace(scene, folder=tmp_path / "a" / "b")) is None
