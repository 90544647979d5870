"""The page of a scene in a browser that we did not write: headless Chromium."""

import re
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from rig.view.pages.page import ScenePage
from rig.view.pictures.layers import picture_of
from rig.view.pictures.look import LUMINANCE, Look
from rig.view.serving.state import State

SLOW_MS = 9000
"""Slow frames for so long, of which viser looks at 2500 before it draws fewer pixels."""


def test_the_page_shows_the_scene_at_any_exposure_and_in_any_tones(window) -> None:
    scale = window.page.painter.scene.exposure

    def shown(look: Look) -> Callable[[], np.ndarray]:
        return lambda: look.shown(window.page.frame.light, scale)

    window.until(lambda: window.shows(shown(Look(tones="AgX"))))
    assert not window.shows(shown(Look(3.0, "AgX")))
    window.tab.locator("input[inputmode=decimal]").fill("3")
    window.tab.keyboard.press("Enter")
    window.until(lambda: window.shows(shown(Look(3.0, "AgX"))))
    window.choose("AgX", "linear")
    window.until(lambda: window.shows(shown(Look(3.0))))


def test_a_drag_moves_the_camera_and_a_click_measures_light(window) -> None:
    window.until(lambda: window.page.frame.light.shape[1] == window.width)
    before = window.canvas()
    mouse = window.tab.mouse
    mouse.move(300, 300)
    mouse.down()
    mouse.move(380, 320, steps=5)
    mouse.up()
    window.until(lambda: np.abs(window.canvas() - before)[250:].mean() > 4)
    window.until(lambda: window.page.frame.light.shape[1] == window.width)
    mouse.click(200, 400)
    window.until(lambda: "column" in window.page.controls.spot.content)
    height, width = window.page.frame.light.shape[:2]
    column, row = int(200 * width / window.width), int(400 * height / 500)
    assert f"column {column}, row {row} of {width}x{height}" in window.page.controls.spot.content
    luminance = float(window.page.frame.light[row, column] @ LUMINANCE)
    assert f"luminance {luminance:.3g}" in window.page.controls.spot.content


def test_a_reading_follows_the_camera_and_what_is_shown(window) -> None:
    window.until(lambda: window.page.frame.light.shape[1] == window.width)
    window.tab.mouse.click(200, 400)
    window.until(lambda: "column" in window.page.controls.spot.content)
    window.until(lambda: float(np.ptp(window.canvas()[385:415, 185:215].mean(2))) > 150)  # its mark
    before = window.page.controls.spot.content
    window.choose("free", window.page.painter.scene.views[0].name)

    def now() -> bool:
        place = window.page.frame.pixel(*window.page._spot)
        if place is None:
            return False
        luminance = float(window.page.frame.light[place] @ LUMINANCE)
        return f"luminance {luminance:.3g}" in window.page.controls.spot.content

    lens = window.page.painter.scene.views[0].lens
    window.until(lambda: window.page.frame.light.shape[:2] == (lens.height, lens.width))
    window.until(now)
    assert window.page.controls.spot.content != before
    assert f"of {lens.width}x{lens.height}" in window.page.controls.spot.content
    window.choose("render", "depth")
    window.until(lambda: re.search(" away|nothing there", window.page.controls.spot.content) is not None)
    window.page.controls.spot.content = ""
    window.page.refresh()  # as after more of a training
    window.until(lambda: "column" in window.page.controls.spot.content)


PHONE = {"has_touch": True, "device_scale_factor": 2}


def reloaded(window, viewer) -> ScenePage:
    """The page of the same window, opened anew by its own address."""
    known = set(viewer.pages)
    window.tab.reload()
    window.until(lambda: bool(set(viewer.pages) - known))
    window.page = viewer.pages[max(viewer.pages)]
    window.until(lambda: window.page.frame is not None)
    return window.page


def test_a_reload_comes_back_to_what_was_shown(window, viewer) -> None:
    window.tab.locator("input[inputmode=decimal]").fill("1.5")
    window.tab.keyboard.press("Enter")
    window.choose("AgX", "filmic")
    name = window.page.painter.scene.views[0].name
    window.choose("free", name)
    window.until(lambda: "depth" in window.page.controls.show.options)
    window.choose("render", "depth")
    window.until(lambda: "show=depth" in window.tab.evaluate("location.hash"))
    page = reloaded(window, viewer)
    assert page.look == Look(1.5, "filmic")
    window.until(lambda: (page.controls.view.value, page.controls.show.value) == (name, "depth"))
    lens = page.painter.scene.views[0].lens
    window.until(lambda: page.frame.light.shape[:2] == (lens.height, lens.width))


def test_a_window_comes_back_to_its_own_state_after_the_server_was_away(window, viewer) -> None:
    """Another window of the same browser has said its state since, in the cookie that they share."""
    window.tab.locator("input[inputmode=decimal]").fill("1.5")
    window.tab.keyboard.press("Enter")
    window.until(lambda: "stops=1.5" in window.tab.evaluate("location.hash"))
    window.tab.evaluate("document.cookie = `rig_view_state_${location.port}=stops%3D-2; Path=/`")
    known = set(viewer.pages)
    viewer.server._websock_server.disconnect_all_clients()
    window.until(lambda: bool(set(viewer.pages) - known))
    assert viewer.pages[max(viewer.pages)].look == Look(1.5, "AgX")


def test_a_link_leads_to_the_same_spot(window, viewer) -> None:
    def addressed() -> np.ndarray | None:
        """Place of the camera by the address; None while it differs from the true one."""
        start = State.of(window.tab.evaluate("location.hash.slice(1)"), Look()).start
        stands = np.array(window.page.client.camera.position)
        return None if start is None or np.abs(stands - start.position).max() > 1e-3 else stands

    window.until(lambda: addressed() is not None)
    beginning = addressed()
    mouse = window.tab.mouse
    mouse.move(300, 300)
    mouse.down()
    mouse.move(380, 320, steps=5)
    mouse.up()
    window.until(lambda: addressed() is not None and np.abs(addressed() - beginning).max() > 1e-2)
    link, stood = window.tab.evaluate("location.hash"), addressed()
    page = reloaded(window, viewer)
    window.until(lambda: np.abs(np.array(page.client.camera.position) - stood).max() < 1e-2)
    window.until(lambda: window.tab.evaluate("location.hash") != "")
    assert np.abs(np.array(State.of(link[1:], Look()).start.position) - stood).max() < 1e-3


def test_a_tap_measures_and_a_finger_that_moves_turns(open_window, viewer) -> None:
    window = open_window(viewer, width=420, height=860, **PHONE)
    assert window.page.client.camera.image_width > 600  # px of the screen
    cameras = window.tab.get_by_text("Photographs", exact=True)
    assert not cameras.is_visible()
    for across, down in ((60, 300), (300, 360)):  # below the word that Chromium draws without a GPU
        window.tab.touchscreen.tap(across, down)
        spot = (across / 420, down / 860)
        window.until(lambda spot=spot: np.allclose(window.page._spot or (-1, -1), spot, atol=0.01))
        window.until(lambda: window.page._measured[1] == window.page.frame.pixel(*window.page._spot))
        height, width = window.page.frame.light.shape[:2]
        row, column = window.page.frame.pixel(*window.page._spot)
        assert f"column {column}, row {row} of {width}x{height}" in window.page.controls.spot.content
    spot, stood = window.page._spot, np.array(window.page.client.camera.position)
    touch = window.tab.context.new_cdp_session(window.tab)
    for kind, place in (("Start", 100), ("Move", 130), ("Move", 180), ("Move", 240), ("End", None)):
        points = [] if place is None else [{"x": place, "y": 330}]
        touch.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})
    window.until(lambda: np.abs(window.page.client.camera.position - stood).max() > 0.01)
    assert window.page._spot == spot
    window.tab.get_by_text("Cameras", exact=True).tap()
    window.until(cameras.is_visible)


def test_a_wide_window_begins_with_its_controls_unfolded(open_window, viewer) -> None:
    """Begin so with any shape and any pixels."""
    window = open_window(viewer, width=640, height=860, **PHONE)
    window.until(window.tab.get_by_text("Photographs", exact=True).is_visible)


def test_a_view_is_seen_through_its_own_lens_beside_what_it_should_be(window) -> None:
    painter = window.page.painter
    name = next(iter(painter.references))
    view = painter.scene.view(name)
    window.choose("free", name)
    truth = painter.scene.render(view.splat_camera)
    window.until(lambda: window.page.frame.light.shape == truth.shape)
    np.testing.assert_allclose(window.page.frame.light, truth, rtol=1e-4, atol=1e-4 * truth.max())
    window.choose("render", "difference")
    window.until(lambda: window.page.controls.legend.label == "render over the reference: -2 to +2 stops")
    window.choose("difference", "reference")
    window.until(lambda: not np.allclose(window.page.frame.light, truth, rtol=1e-3))
    window.tab.mouse.move(300, 300)
    window.tab.wait_for_timeout(600)
    window.tab.mouse.down()
    window.tab.mouse.move(340, 310, steps=4)
    window.tab.mouse.up()
    window.until(lambda: window.page.controls.view.value == "free")
    window.until(lambda: window.page.frame.light.shape[1] == window.width)


def test_a_view_is_shown_pixel_for_pixel(window, viewer) -> None:
    assert not window.tab.get_by_label("1:1", exact=True).is_visible()
    view = window.page.painter.scene.views[0]
    window.choose("free", view.name)
    window.tab.get_by_label("1:1", exact=True).check()
    window.until(lambda: "centre=0.5+0.5" in window.tab.evaluate("location.hash"))

    def exact(page: ScenePage) -> bool:
        """The canvas has the view's own pixels in its middle, around the centre of the page."""
        shown = page.controls.look.shown(page.frame.light, page.painter.scene.exposure)
        left = window.width // 2 - int(page._centre[0] * view.lens.width)
        top = window.height // 2 - int(page._centre[1] * view.lens.height)
        here = window.canvas()[top : top + view.lens.height, left : left + view.lens.width]
        off = np.abs(here - shown).max(axis=2)
        return bool(np.quantile(off, 0.9) <= 1)  # the mark is the rest

    window.until(lambda: exact(window.page))
    # A click brings its pixel to the middle, and the address keeps that.
    window.tab.mouse.click(window.width // 2 + 6, window.height // 2 - 5)
    row, column = view.lens.height // 2 - 5, view.lens.width // 2 + 6
    window.until(
        lambda: window.page._centre == ((column + 0.5) / view.lens.width, (row + 0.5) / view.lens.height)
    )
    window.until(lambda: f"column {column}, row {row} of" in window.page.controls.spot.content)
    window.until(lambda: exact(window.page))
    window.until(lambda: "centre=0.5+0.5" not in window.tab.evaluate("location.hash"))
    centre = window.page._centre
    page = reloaded(window, viewer)
    window.until(lambda: page.controls.pixels.value and page.controls.view.value == view.name)
    assert np.allclose(page._centre, centre, atol=1e-4)


def test_a_large_window_has_a_pixel_of_the_picture_in_each_of_its_own(open_window, viewer) -> None:
    window = open_window(viewer, width=2000, height=400)
    assert window.width > 1280
    window.until(lambda: window.page.frame.light.shape[:2] == (400, window.width))


def test_a_slow_browser_draws_every_pixel_of_its_screen(open_window, viewer) -> None:
    """Viser draws an eighth fewer a side after a few seconds of slow frames, unless it knows the ratio."""
    slow = (
        "const frame = requestAnimationFrame.bind(window);"
        "window.requestAnimationFrame = (draw) => setTimeout(() => frame(draw), 60)"
    )
    window = open_window(viewer, script=slow)
    window.tab.mouse.move(200, 200)
    window.tab.mouse.down()
    widths, step = set(), 0
    until = window.tab.evaluate("performance.now()") + SLOW_MS
    while window.tab.evaluate("performance.now()") < until:
        window.tab.mouse.move(200 + step % 50, 200)
        step += 1
        widths.add(window.tab.evaluate("document.querySelector('canvas[data-engine]').width"))
    window.tab.mouse.up()
    assert widths == {window.width}
    assert "fixedDpr" not in window.tab.evaluate("location.href")


def test_a_view_that_was_just_left_is_not_looked_for(window) -> None:
    """One thread takes the name of the view back, another draws before it takes back what only a view has."""
    page = window.page
    gone = SimpleNamespace(
        view=SimpleNamespace(value="free"), show=SimpleNamespace(value="reference"), parts=page.controls.parts
    )
    wanted = ScenePage._wanted(
        SimpleNamespace(client=page.client, controls=gone, painter=page.painter), False
    )
    assert (wanted.show, wanted.view) == ("render", None)
    assert page.painter.draw(wanted).light.any()


def test_keys_step_through_exposures_and_photographs(window) -> None:
    window.tab.get_by_text("Full screen", exact=True).wait_for()  # the last to come
    window.tab.keyboard.press("b")
    window.until(lambda: window.page.controls.exposure.value == 1.0)
    window.tab.keyboard.press("n")
    first = window.page.painter.scene.views[0]
    window.until(lambda: window.page.controls.view.value == first.name)
    window.until(lambda: window.page.frame.light.shape[:2] == (first.lens.height, first.lens.width))
    window.tab.keyboard.press("h")
    window.until(lambda: window.page.controls.view.value == "free")
    window.tab.get_by_text("Full screen", exact=True).click()
    window.until(lambda: window.tab.evaluate("document.fullscreenElement !== null"))


def test_depth_and_trust_are_shown_and_measured(window) -> None:
    painter = window.page.painter
    window.choose("render", "depth")
    window.until(lambda: window.page._drawing.layer is not None)
    window.until(lambda: window.shows(lambda: picture_of("depth", window.page._drawing.layer, painter.scene)))
    window.choose("depth", "trust")
    window.until(lambda: "photographs" in (window.page.controls.legend.label or ""))
    window.until(lambda: window.page._drawing.layer is not None and window.page._drawing.layer.max() > 1)
    window.tab.mouse.click(200, 400)
    window.until(lambda: "photographs** saw it" in window.page.controls.spot.content)


def test_cameras_hold_their_photographs_and_are_stood_at(window) -> None:
    window.tab.get_by_label("Photographs", exact=True).check()
    window.until(lambda: window.page._frusta.visible)
    scene = window.page.painter.scene

    def pictured() -> bool:
        handles = [
            window.page.client.scene.get_handle_by_name(f"/cameras/{view.name}") for view in scene.views
        ]
        # viser knows a handle by its name before it has its picture.
        return all(getattr(handle, "image", None) is not None for handle in handles)

    window.until(pictured)
    window.page._frusta.on_click(scene.views[0].name)
    window.until(lambda: window.page.controls.view.value == scene.views[0].name)
