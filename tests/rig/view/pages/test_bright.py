"""The page on an HDR screen, which headless Chromium is not: it is made to believe so."""

import base64
import itertools
import subprocess

import numpy as np
import pytest

from imaging.colour.spaces import PRIMARIES, rec709_from_rgb
from imaging.files.hdr_display import WHITE
from rig.view.pictures.look import Look
from tests.imaging.files.test_hdr_display import pq_light
from tests.rig.view.conftest import Window

HIGH = """
const ask = window.matchMedia.bind(window);
window.matchMedia = (words) => words === "(dynamic-range: high)"
  ? Object.assign(new EventTarget(), { matches: true }) : ask(words);
"""
COVER = "#rig-bright-shown"


class Believing:
    """A browser whose windows believe to be on an HDR screen."""

    def __init__(self, browser) -> None:
        self._browser = browser

    def new_page(self, **device: object) -> object:
        tab = self._browser.new_page(**device)
        tab.add_init_script(HIGH)
        return tab


def light_in(avif: bytes, folder) -> np.ndarray:
    """Linear Rec.709 [H, W, 3], 1 as white, by dav1d and the published curve."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    (folder / "a.avif").write_bytes(avif)
    size = subprocess.run([ffmpeg, "-i", folder / "a.avif"], capture_output=True).stderr.decode()
    width, height = (int(side) for side in size.split("smpte2084")[1].split(" ")[1].rstrip(",").split("x"))
    arguments = ["-i", folder / "a.avif", "-f", "rawvideo", "-pix_fmt", "gbrp16le", "-"]
    raw = subprocess.run([ffmpeg, *arguments], capture_output=True, check=True).stdout
    planes = np.frombuffer(raw, "<u2").reshape(3, height, width) / 65535
    return pq_light(np.moveaxis(planes[[2, 0, 1]], 0, -1)) @ rec709_from_rgb(PRIMARIES["rec2020"]).T / WHITE


def test_an_hdr_screen_gets_the_light_over_the_picture(browser, viewer, tmp_path) -> None:
    window = Window(Believing(browser), viewer)
    tab = window.tab
    tab.locator(COVER).wait_for()
    number = tab.locator(COVER).get_attribute("data-number")
    tab.locator("input[inputmode=decimal]").fill("3")
    tab.keyboard.press("Enter")
    window.until(lambda: window.page.look.exposure == 3)
    window.until(lambda: tab.locator(COVER).get_attribute("data-number") != number)
    tab.wait_for_timeout(500)
    over, under = (tab.locator(name).bounding_box() for name in (COVER, "canvas[data-engine]"))
    assert over == pytest.approx(under)
    source = tab.locator(COVER).get_attribute("src").partition(",")[2]
    shown = light_in(base64.b64decode(source), tmp_path)
    truth = window.page.frame.light * window.page.painter.scene.exposure * 8
    assert shown.shape == truth.shape
    luminance = [np.maximum(light @ [0.2126, 0.7152, 0.0722], 1e-3) for light in (shown, truth.clip(0, 16))]
    assert np.median(np.abs(np.diff(np.log2(luminance), axis=0))) < 0.05
    assert shown.max() > 4
    tab.mouse.move(300, 300)
    tab.mouse.down()
    steps = itertools.cycle([*range(300, 380, 4), *range(380, 300, -4)])

    def gone_while_moving() -> bool:
        # The light comes back as soon as the view rests, maybe between two looks of a busy machine.
        tab.mouse.move(next(steps), 320)
        return tab.locator(COVER).count() == 0

    window.until(gone_while_moving)
    tab.mouse.up()
    tab.locator(COVER).wait_for()
    tab.get_by_label("HDR", exact=True).uncheck()
    window.until(lambda: tab.locator(COVER).count() == 0)
    look = Look(3.0, "AgX")
    window.until(
        lambda: window.shows(lambda: look.shown(window.page.frame.light, window.page.painter.scene.exposure))
    )
    tab.get_by_label("HDR", exact=True).check()
    tab.locator(COVER).wait_for()
    window.choose("render", "depth")
    window.until(lambda: tab.locator(COVER).count() == 0)
    tab.close()


def test_another_screen_has_neither_switch_nor_light(window) -> None:
    window.tab.get_by_text("Full screen", exact=True).wait_for()  # the last to come
    assert not window.tab.get_by_label("HDR", exact=True).is_visible()
    assert window.tab.locator(COVER).count() == 0
