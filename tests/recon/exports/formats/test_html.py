"""The page of a scene in headless Chromium, against what `rig` draws of the scene and how it shows light."""

import base64
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from imaging.errors import ReconstructionError
from imaging.optics.lens import Lens
from recon.data.world import SAME
from recon.exports.export import export
from recon.exports.formats.html import _view
from recon.exports.loss import drawn, stops_between
from recon.exports.splats import linear_splats
from recon.exports.target_coordinates import pinhole
from recon.result.model import SceneShot
from recon.result.scene import Scene, open_scene
from rig.view.pages.opening import look_of
from rig.view.pictures.look import Look
from tests.recon.exports.made_scene import write_made
from tests.recon.rendering.scenes import view as view_of

STILL = "canvas[aria-busy=false]"
BARE = "element('panel').style.display = 'none'; moved(); stand(0)"
READ = """(() => {
  const light = new Uint8Array(lightAt(0, 0, canvas.width, canvas.height).buffer);
  let text = "";
  for (let i = 0; i < light.length; i += 8192) text += String.fromCharCode(...light.subarray(i, i + 8192));
  return [canvas.width, canvas.height, btoa(text)];
})()"""
FAINT = 2.0**-20
"""Radiance in the scenes here that counts as faint, about their `reference` times `normaliser`."""


@pytest.fixture
def opened(browser: Any, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Opens the page of a scene in a window of that size; with `bare`, the picture fills it."""
    tabs = []

    def open_page(scene: Scene, width: int, height: int, *, bare: bool = True, before: str = "") -> Any:
        export(scene, tmp_path / "scene.html")
        tab = browser.new_page(viewport={"width": width, "height": height})
        tabs.append(tab)
        tab.add_init_script(before)
        tab.wrong = []
        tab.on("pageerror", lambda error: tab.wrong.append(str(error)))
        tab.on(
            "request", lambda request: tab.wrong.append(request.url) if "http" in request.url[:5] else None
        )
        tab.goto((tmp_path / "scene.html").as_uri())
        if not before:
            if bare:
                tab.evaluate(BARE)
            tab.locator(STILL).wait_for()
            assert tab.wrong == []
        return tab

    yield open_page
    for tab in tabs:
        tab.close()


def light_of(tab: Any, scene: Scene) -> np.ndarray:
    """The radiance [H, W, 3] that the page has drawn."""
    tab.locator(STILL).wait_for()
    width, height, text = tab.evaluate(READ)
    light = np.frombuffer(base64.b64decode(text), "<f4").reshape(height, width, 4)
    return light[::-1, :, :3] / scene.exposure


def pixels(tab: Any) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(tab.screenshot())).convert("RGB"))


@pytest.mark.parametrize("name", ["made", "made_sky"])
def test_views_have_the_light_that_rig_draws(
    name: str, opened: Callable[..., Any], request: pytest.FixtureRequest
) -> None:
    scene = open_scene(request.getfixturevalue(name))
    tab = opened(scene, 48, 36)
    for number, view in enumerate(scene.views):
        tab.evaluate(f"stand({number})")
        truth = scene.render(pinhole(view.splat_camera))
        off = stops_between(truth, light_of(tab, scene), FAINT)
        assert np.median(off) < 0.001
        assert np.quantile(off, 0.99) < 0.01
        assert np.ptp(np.log2(truth[truth > 0])) > 8  # else anything would do


def test_colours_by_direction_are_those_of_plain_harmonics(
    opened: Callable[..., Any], tmp_path: Path
) -> None:
    """Bound what the page adds to the loss of harmonics, which all files of splats have in common."""
    scene = open_scene(write_made(tmp_path / "shiny", degree=2, seed=1, bent=False))
    splats = linear_splats(scene, scene.exposure, with_dome=False)
    tab = opened(scene, 48, 36)
    off = stops_between(drawn(scene, splats, scene.views[0].splat_camera), light_of(tab, scene), FAINT)
    flat = replace(splats, harmonics=splats.harmonics[:, :1])
    without = stops_between(drawn(scene, flat, scene.views[0].splat_camera), light_of(tab, scene), FAINT)
    assert np.median(off) < 0.01
    assert np.quantile(off, 0.99) < 0.1
    assert np.median(off) < 0.05 * np.median(without)


@pytest.mark.parametrize("width", [12, 240])
def test_nearer_and_farther_than_trained_gaussians_keep_their_look(
    width: int, scene: Scene, opened: Callable[..., Any]
) -> None:
    camera = pinhole(scene.views[0].splat_camera).resized(width)
    tab = opened(scene, camera.width, camera.height)
    light = light_of(tab, scene)
    off = stops_between(scene.render(camera), light, FAINT)
    assert np.median(off) < 0.002
    assert np.quantile(off, 0.99) < 0.02
    untrained = replace(scene, renderer=replace(scene.renderer, sampling=None))
    assert np.median(stops_between(untrained.render(camera), light, FAINT)) > 5 * np.median(off)


def test_the_slider_and_the_keys_expose_by_stops(scene: Scene, opened: Callable[..., Any]) -> None:
    tab = opened(scene, 240, 180)
    tab.evaluate("element('tones').selectedIndex = 0; again()")
    light = light_of(tab, scene)

    def shows(stops: float, tones: str = "linear") -> bool:
        expected = Look(stops, tones).shown(np.float32(light), scene.exposure)
        return bool(np.abs(expected.astype(float) - pixels(tab)).max() <= 2)

    assert shows(0)
    tab.keyboard.press("v")
    tab.keyboard.press("v")
    assert shows(-2)
    assert not shows(-1.9)
    tab.evaluate("element('stops').value = '5.5'; element('stops').dispatchEvent(new Event('input'))")
    assert shows(5.5)
    tab.keyboard.press("b")
    assert shows(6.5)
    assert tab.locator("#told").text_content() == "+6.5 stops"
    for number, tones in ((1, "AgX"), (2, "filmic")):
        tab.evaluate(f"element('tones').selectedIndex = {number}; again()")
        assert shows(6.5, tones)
    assert np.allclose(light_of(tab, scene), light)  # it is not exposed itself


def shot(scene: Scene, file: str, k: float) -> Scene:
    """The scene with one photograph of that name and exposure in each of its views."""
    views = tuple(
        view.model_copy(update={"shots": (SceneShot(file=file, k=k),)}) for view in scene.record.views
    )
    return replace(scene, record=scene.record.model_copy(update={"views": views}))


@pytest.mark.parametrize("file", ["raw/0000/a_0.dng", "raw/0000/a_0.jpg"])
def test_it_begins_as_rig_view_does(file: str, scene: Scene, opened: Callable[..., Any]) -> None:
    """RAW in AgX; what a camera developed as it was shot, here two stops and a bit brighter."""
    made = shot(scene, file, 4.6 * scene.exposure)
    tab = opened(made, 240, 180)
    look = look_of(made)
    assert look == (Look(2.2, "linear") if file.endswith("jpg") else Look(0.0, "AgX"))
    assert (tab.locator("#tones").input_value(), tab.locator("#stops").input_value()) == (
        look.tones,
        f"{look.exposure:g}",
    )
    expected = look.shown(np.float32(light_of(tab, made)), made.exposure)
    assert np.abs(expected.astype(float) - pixels(tab)).max() <= 2
    other = Look(look.exposure, "filmic").shown(np.float32(light_of(tab, made)), made.exposure)
    assert np.abs(other.astype(float) - pixels(tab)).max() > 10


def test_an_exposure_that_was_chosen_is_where_it_begins(
    scene: Scene, opened: Callable[..., Any], tmp_path: Path
) -> None:
    developed = shot(scene, "a.jpg", 4.6 * scene.exposure)
    tab = opened(developed, 48, 36)
    export(developed, tmp_path / "other.html", exposure=3.0)
    tab.goto((tmp_path / "other.html").as_uri())
    tab.locator(STILL).wait_for()
    assert (tab.locator("#tones").input_value(), tab.locator("#stops").input_value()) == ("linear", "0")


def test_display_values_begin_as_they_are(made: Path, opened: Callable[..., Any], tmp_path: Path) -> None:
    export(made, tmp_path / "shown.ply")
    shown = open_scene(tmp_path / "shown.ply")
    tab = opened(shown, 48, 36)
    assert (tab.locator("#tones").input_value(), tab.locator("#stops").input_value()) == ("linear", "0")


def test_it_is_turned_shifted_and_taken_home(scene: Scene, opened: Callable[..., Any]) -> None:
    tab = opened(scene, 240, 180)
    home = light_of(tab, scene)

    def moved(act: Callable[[], object]) -> None:
        before = light_of(tab, scene)
        act()
        tab.locator(STILL).wait_for()
        assert np.median(stops_between(before, light_of(tab, scene), 1e-3)) > 0.01

    def dragged(button: str) -> None:
        tab.mouse.move(120, 90)
        tab.mouse.down(button=button)
        tab.mouse.move(150, 100, steps=3)
        tab.mouse.up(button=button)

    middle = "plus(camera.centre, camera.axes[2], camera.away)"
    before = tab.evaluate(middle)
    moved(lambda: dragged("left"))
    assert np.allclose(tab.evaluate(middle), before)
    moved(lambda: dragged("right"))
    moved(lambda: tab.mouse.wheel(0, -300))
    moved(lambda: tab.keyboard.press("w", delay=100))
    assert tab.locator("#view").input_value() == ""
    moved(lambda: tab.keyboard.press("n"))
    assert tab.locator("#view").input_value() == "1"
    moved(lambda: tab.keyboard.press("h"))
    np.testing.assert_array_equal(light_of(tab, scene), home)


def test_a_click_measures(made_sky: Path, opened: Callable[..., Any]) -> None:
    scene = open_scene(made_sky)
    tab = opened(scene, 900, 500, bare=False)
    tab.mouse.click(200, 300)
    light = light_of(tab, scene)[300, 200]
    luminance = float(light @ [0.2126, 0.7152, 0.0722])
    text = tab.locator("#spot").text_content()
    stops, value = re.match(r"\+?(-?[\d.]+) stops from .* · (\S+) cd/m²", text).groups()
    assert float(stops) == pytest.approx(np.log2(luminance * scene.exposure / 0.18), abs=0.01)
    assert float(value) == pytest.approx(luminance * 250, rel=0.01)


def test_it_fits_a_telephone(scene: Scene, opened: Callable[..., Any]) -> None:
    tab = opened(scene, 420, 800, bare=False)
    assert tab.evaluate("document.documentElement.scrollWidth") == 420
    picture, panel = (tab.locator(name).bounding_box() for name in ("#canvas", "#panel"))
    assert picture["width"] == panel["width"] == 420
    assert picture["height"] > 500
    assert picture["y"] + picture["height"] <= panel["y"] + 0.5
    assert panel["y"] + panel["height"] <= 800.5


@pytest.mark.parametrize(
    ("before", "words"),
    [
        ("HTMLCanvasElement.prototype.getContext = () => null", "This browser has no WebGL 2"),
        (
            "WebGL2RenderingContext.prototype.getExtension = () => null",
            "cannot draw into floating-point pictures",
        ),
        ("delete window.DecompressionStream", "cannot unpack the scene"),
    ],
)
def test_browsers_that_cannot_show_it_are_told_so(
    before: str, words: str, scene: Scene, opened: Callable[..., Any]
) -> None:
    tab = opened(scene, 420, 800, before=before)
    said = tab.locator("#refusal")
    said.wait_for()
    assert words in said.text_content()
    assert said.text_content().endswith(".")


def test_16_bits_are_enough_where_floats_of_32_are_not_blended(
    made: Path, opened: Callable[..., Any]
) -> None:
    scene = open_scene(made)
    tab = opened(
        scene,
        48,
        36,
        before="const all = WebGL2RenderingContext.prototype.getExtension;"
        "WebGL2RenderingContext.prototype.getExtension = function (name) {"
        "return name === 'EXT_float_blend' ? null : all.call(this, name) }",
    )
    tab.locator(STILL).wait_for()
    assert "16 bits" in tab.locator("#spot").text_content()
    tab.evaluate(BARE)
    off = stops_between(scene.render(pinhole(scene.views[0].splat_camera)), light_of(tab, scene), 2.0**-20)
    assert np.quantile(off, 0.99) < 0.2


def test_a_scene_without_views_is_refused(scene: Scene, tmp_path: Path) -> None:
    bare = replace(scene, record=scene.record.model_copy(update={"views": ()}))
    with pytest.raises(ReconstructionError, match="has no views, at which a page begins"):
        export(bare, tmp_path / "scene.html")
    assert not list(tmp_path.iterdir())


def test_names_are_text(made: Path, tmp_path: Path) -> None:
    """A folder cannot write into the page what a browser would run."""
    scene = replace(open_scene(made), folder=tmp_path / "<script>alert(1)<" / "script>")
    export(scene, tmp_path / "scene.html")
    text = (tmp_path / "scene.html").read_text()
    assert "<title>script&gt;</title>" in text
    assert not re.search(r"(src|href)=", text)


@pytest.mark.parametrize(
    ("orientation", "shown"),
    [
        (1, lambda u, v: (u, v)),
        (3, lambda u, v: (48 - u, 30 - v)),
        (6, lambda u, v: (30 - v, u)),
        (8, lambda u, v: (v, 48 - u)),
    ],
)
def test_views_stand_upright_as_their_files_state(
    orientation: int, shown: Callable[..., tuple[float, float]]
) -> None:
    placed = SimpleNamespace(record=SimpleNamespace(world=SAME))
    lens = Lens(model="PINHOLE", width=48, height=30, fx=40.0, fy=42.0, cx=23.0, cy=16.0)
    upright = _view(placed, view_of(lens=lens).model_copy(update={"orientation": orientation}))
    assert (upright["width"], upright["height"]) == ((48, 30) if orientation in (1, 3) else (30, 48))
    x, y, z = np.reshape(upright["turn"], (3, 3)) @ (np.array((0.3, 0.2, 1.0)) - upright["centre"])
    pixel = upright["fx"] * x / z + upright["cx"], upright["fy"] * y / z + upright["cy"]
    assert pixel == pytest.approx(shown(40 * 0.3 + 23, 42 * 0.2 + 16))
