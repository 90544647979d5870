"""A window of the browser, for tests of pages."""

import io
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imaging.session.paths import find_reconstruction
from rig.view.pages.opening import show_scenes
from rig.view.serving.server import Viewer

CANVAS = "document.querySelector('canvas[data-engine]').clientWidth * devicePixelRatio"
AT_REST = 30
"""Looks at a canvas, 20 ms apart or more, that find it as wide as before, until it counts as at rest."""
LIMIT = 120.0
"""Seconds that a browser without a GPU may take for anything."""


@pytest.fixture(scope="package")
def viewer(scene_template: Path) -> Iterator[Viewer]:
    with Viewer("toy", 0) as running:
        show_scenes(running, [find_reconstruction(scene_template)], print)
        yield running


class Window:
    """A window of the browser, and the page that draws for it."""

    def __init__(
        self, browser, viewer: Viewer, width: int = 900, height: int = 500, script: str = "", **device: object
    ) -> None:
        """Open the window; script: that its page runs before its own."""
        known = set(viewer.pages)
        self.height = height
        self.tab = browser.new_page(viewport={"width": width, "height": height}, **device)
        self.tab.add_init_script(script)
        self.tab.goto(viewer.url)
        self.until(lambda: bool(set(viewer.pages) - known))
        self.page = viewer.pages[max(viewer.pages)]
        self.until(lambda: self.page.frame is not None)
        self.tab.get_by_text("Exposure, stops", exact=True).wait_for()
        self._until_at_rest()

    def _until_at_rest(self) -> None:
        """Wait for the panel: on a busy machine it slides in beside the canvas some time after its text."""
        widths: list[int] = []

        def at_rest() -> bool:
            moving = self.tab.evaluate("document.getAnimations().length") > 0
            if moving or self.width != self.tab.evaluate(CANVAS) or self.width != (widths or [0])[-1]:
                widths.clear()
            widths.append(self.width)
            return len(widths) > AT_REST

        self.until(at_rest)

    def until(self, done: Callable[[], bool]) -> None:
        end = time.monotonic() + LIMIT
        while not done():
            assert time.monotonic() < end
            self.tab.wait_for_timeout(20)

    def canvas(self) -> np.ndarray:
        """Canvas of the scene in the browser, [H, W, 3] in 0..255."""
        shot = Image.open(io.BytesIO(self.tab.screenshot())).convert("RGB")
        return np.asarray(shot, np.float64)[:, : self.width]

    @property
    def width(self) -> int:
        return int(self.page.client.camera.image_width)

    def shows(self, picture: Callable[[], np.ndarray]) -> bool:
        """Return whether the lower half of the canvas, where nothing lies over it, is a picture, but for
        JPEG.
        """
        truth, drawn = np.asarray(picture(), np.float64), self.canvas()
        if truth.shape != drawn.shape:
            truth = np.asarray(Image.fromarray(truth.astype(np.uint8)).resize(drawn.shape[1::-1]), np.float64)
        return bool(np.abs(truth - drawn)[self.height // 2 :].mean() < 4)

    def choose(self, now: str, wanted: str) -> None:
        self.tab.locator(f"input:not([type=hidden])[value='{now}']").first.click()
        self.tab.get_by_role("option", name=wanted, exact=True).click()


@pytest.fixture
def open_window(browser) -> Iterator[Callable[..., Window]]:
    opened = []

    def open_one(viewer: Viewer, **window: object) -> Window:
        opened.append(Window(browser, viewer, **window))
        return opened[-1]

    yield open_one
    for window in opened:
        window.tab.close()


@pytest.fixture
def window(open_window, viewer: Viewer) -> Window:
    return open_window(viewer)
