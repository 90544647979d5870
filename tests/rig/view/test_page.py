"""The page of a scene in a browser that we did not write: headless Chromium."""

import io
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import viser
import websockets.sync.client
from PIL import Image

from imaging.session.paths import find_reconstruction
from recon.result.scene import open_scene
from rig.view.look import LUMINANCE, Look
from rig.view.page import Page
from rig.view.server import Viewer

playwright = pytest.importorskip("playwright.sync_api")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
LIMIT = 20.0
"""Seconds that a browser without a GPU may take for anything."""


@pytest.fixture(scope="module")
def viewer(scene_template: Path) -> Iterator[Viewer]:
    with Viewer(open_scene(find_reconstruction(scene_template)), 0) as found:
        yield found


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed: apt-get install chromium")
    software = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=software)
        yield chromium
        chromium.close()


class Window:
    """A window of the browser, and the page that draws for it."""

    def __init__(self, browser, viewer: Viewer) -> None:
        known = set(viewer.pages)
        self.tab = browser.new_page(viewport={"width": 900, "height": 500})
        self.tab.goto(viewer.url)
        self.until(lambda: bool(set(viewer.pages) - known))
        self.page: Page = viewer.pages[max(viewer.pages)]
        self.until(lambda: self.page.frame is not None)

    def until(self, done: Callable[[], bool]) -> None:
        end = time.monotonic() + LIMIT
        while not done():
            assert time.monotonic() < end
            self.tab.wait_for_timeout(20)

    def canvas(self) -> np.ndarray:
        """What the browser shows of the scene, [H, W, 3] in 0..255."""
        shot = Image.open(io.BytesIO(self.tab.screenshot())).convert("RGB")
        return np.asarray(shot, np.float64)[:, : self.width]

    @property
    def width(self) -> int:
        return int(self.page.client.camera.image_width)

    def shows(self, picture: Callable[[], np.ndarray]) -> bool:
        """Whether the lower half of the canvas, where nothing lies over it, is a picture, but for JPEG."""
        truth, seen = np.asarray(picture(), np.float64), self.canvas()
        if truth.shape != seen.shape:
            truth = np.asarray(Image.fromarray(truth.astype(np.uint8)).resize(seen.shape[1::-1]), np.float64)
        return bool(np.abs(truth - seen)[250:].mean() < 4)

    def choose(self, now: str, wanted: str) -> None:
        self.tab.locator(f"input:not([type=hidden])[value='{now}']").first.click()
        self.tab.get_by_role("option", name=wanted, exact=True).click()


@pytest.fixture
def window(browser, viewer: Viewer) -> Iterator[Window]:
    opened = Window(browser, viewer)
    yield opened
    opened.tab.close()


def test_the_page_shows_the_scene_at_any_exposure_and_in_any_tones(window: Window, viewer: Viewer) -> None:
    scale = viewer.scene.exposure

    def shown(look: Look) -> Callable[[], np.ndarray]:
        return lambda: look.shown(window.page.frame.light, scale)

    window.until(lambda: window.shows(shown(Look())))
    assert not window.shows(shown(Look(3.0)))
    window.tab.locator("input[inputmode=decimal]").fill("3")
    window.tab.keyboard.press("Enter")
    window.until(lambda: window.shows(shown(Look(3.0))))
    window.choose("sRGB", "false colour")
    window.until(lambda: window.shows(shown(Look(3.0, "false colour"))))
    window.tab.get_by_alt_text("-8 to +8").is_visible()


def test_a_drag_moves_the_camera_and_a_click_measures_light(window: Window) -> None:
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
    window.until(lambda: "column" in window.page._spot.content)
    height, width = window.page.frame.light.shape[:2]
    column, row = int(200 * width / window.width), int(400 * height / 500)
    assert f"column {column}, row {row} of {width}x{height}" in window.page._spot.content
    luminance = float(window.page.frame.light[row, column] @ LUMINANCE)
    assert f"luminance {luminance:.3g}" in window.page._spot.content


def test_a_view_is_seen_through_its_own_lens_beside_what_it_should_be(window: Window, viewer: Viewer) -> None:
    name = next(iter(viewer._references))
    view = viewer.scene.view(name)
    window.choose("free", name)
    truth = viewer.scene.render(view.splat_camera)
    window.until(lambda: window.page.frame.light.shape == truth.shape)
    np.testing.assert_allclose(window.page.frame.light, truth, rtol=1e-4, atol=1e-4 * truth.max())
    window.choose("render", "difference")
    window.until(lambda: window.page._legend.label == "-2 to +2 stops above the reference")
    window.choose("difference", "reference")
    window.until(lambda: not np.allclose(window.page.frame.light, truth, rtol=1e-3))
    window.tab.mouse.move(300, 300)
    window.tab.wait_for_timeout(600)
    window.tab.mouse.down()
    window.tab.mouse.move(340, 310, steps=4)
    window.tab.mouse.up()
    window.until(lambda: window.page._view.value == "free")
    window.until(lambda: window.page.frame.light.shape[1] == window.width)


def test_pages_of_other_sites_are_refused(viewer: Viewer) -> None:
    def connect(origin: str) -> None:
        address, protocols = (
            viewer.url.replace("http", "ws"),
            [websockets.Subprotocol(f"viser-v{viser.__version__}")],
        )
        websockets.sync.client.connect(address, origin=origin, subprotocols=protocols).close()

    connect(viewer.url)
    connect("http://localhost:1234")
    for stranger in ("http://example.org", "http://localhost.example.org", "https://127.0.0.1.example.org"):
        with pytest.raises(websockets.exceptions.InvalidStatus, match="403"):
            connect(stranger)
    assert viewer.server.get_host() == "127.0.0.1"
