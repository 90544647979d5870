"""The page of a scene on a screen of high dynamic range, which headless Chromium is not.

Its WebGPU without a GPU draws into textures and not onto canvases: the page is handed a texture in their
place, and its own program draws into it.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recon.exports.export import export
from recon.exports.target_coordinates import pinhole
from recon.result.scene import Scene
from rig.view.pages.opening import look_of
from rig.view.pictures.look import Look
from tests.chromium import CHROMIUM, SOFTWARE
from tests.recon.exports.formats.test_html import BARE, STILL, light_of, pixels

HIGH = """
const ask = window.matchMedia.bind(window);
window.screenOfHdr = new EventTarget();
screenOfHdr.matches = true;
window.matchMedia = (words) => words === "(dynamic-range: high)" ? screenOfHdr : ask(words);
"""
CANVAS = """
const plain = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  if (kind !== "webgpu") return plain.call(this, kind, ...more);
  const surface = this;
  let said;
  return {
    configure: (how) => { said = how },
    getConfiguration: () => said,
    getCurrentTexture: () => {
      const { RENDER_ATTACHMENT, COPY_SRC } = GPUTextureUsage, size = [surface.width, surface.height];
      const usage = RENDER_ATTACHMENT | COPY_SRC;
      window.shown = said.device.createTexture({ size, format: said.format, usage });
      window.handed = said;
      return shown;
    },
  };
};
"""
READ = """async () => {
  const { width, height, format } = shown, { device } = handed;
  const bytesPerRow = 256 * Math.ceil(8 * width / 256);
  const usage = GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ;
  const buffer = device.createBuffer({ size: bytesPerRow * height, usage });
  const commands = device.createCommandEncoder();
  commands.copyTextureToBuffer({ texture: shown }, { buffer, bytesPerRow }, [width, height]);
  device.queue.submit([commands.finish()]);
  await buffer.mapAsync(GPUMapMode.READ);
  const bytes = Array.from(new Uint8Array(buffer.getMappedRange()));
  return { bytes, width, height, format, mode: handed.toneMapping.mode, space: handed.colorSpace };
}"""


@pytest.fixture(scope="module")
def gpu(browser: Any) -> Iterator[Any]:
    """A browser with WebGPU."""
    switches = (*SOFTWARE, "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader")
    running = browser.browser_type.launch(executable_path=CHROMIUM, args=switches)
    yield running
    running.close()


def opened(browser: Any, scene: Scene, folder: Path, before: str) -> Any:
    export(scene, folder / "scene.html")
    tab = browser.new_page(viewport={"width": 240, "height": 180})
    tab.wrong = []
    tab.on("pageerror", lambda error: tab.wrong.append(str(error)))
    tab.on("console", lambda line: tab.wrong.append(line.text) if line.type == "error" else None)
    tab.add_init_script(before)
    tab.goto((folder / "scene.html").as_uri())
    tab.evaluate(BARE)
    tab.locator(STILL).wait_for()
    return tab


def on_screen(tab: Any) -> np.ndarray:
    """Codes [H, W, 3] that the page hands to the screen, 1 as white."""
    tab.locator(STILL).wait_for()
    said = tab.evaluate(READ)
    assert (said["format"], said["mode"], said["space"]) == ("rgba16float", "extended", "srgb")
    rows = np.frombuffer(bytes(said["bytes"]), np.uint8).reshape(said["height"], -1)
    codes = rows[:, : 8 * said["width"]].copy().view("<f2").reshape(said["height"], said["width"], 4)
    return codes[..., :3].astype(float)


def light_from(codes: np.ndarray) -> np.ndarray:
    """Light of sRGB that goes on above white, as CSS Color 4 extends IEC 61966-2-1."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def until(tab: Any, condition: str) -> None:
    """Wait for a condition of the page, whose policy forbids what Playwright's own waits evaluate."""
    for _ in range(3000):
        if tab.evaluate(condition):
            return
        tab.wait_for_timeout(20)
    raise AssertionError(f"after a minute not yet: {condition}")


def test_an_hdr_screen_gets_the_light_unclipped(gpu: Any, scene: Scene, tmp_path: Path) -> None:
    assert look_of(scene) == Look(0.0, "AgX")
    tab = opened(gpu, scene, tmp_path, HIGH + CANVAS)
    until(tab, "element('tones').value === 'HDR' && !element('bright').hidden")
    assert tab.locator("#bright").is_visible()
    until(tab, "window.shown && shown.width === 240")
    truth = scene.render(pinhole(scene.views[0].splat_camera).resized(240)) * scene.exposure
    for key, factor in (("b", 2.0), ("b", 4.0), ("v", 2.0)):
        tab.keyboard.press(key)
        until(tab, f"element('told').textContent.startsWith('+{np.log2(factor):.0f}')")
        tab.evaluate("new Promise(requestAnimationFrame)")
        shown = light_from(on_screen(tab))
        np.testing.assert_allclose(
            shown, light_of(tab, scene) * scene.exposure * factor, rtol=5e-3, atol=1e-4
        )
        off = np.abs(np.log2(np.maximum(shown, 1e-4) / np.maximum(truth * factor, 1e-4)))
        assert np.quantile(off, 0.99) < 0.05
    assert shown.max() > 16  # else nothing was tested above white
    assert tab.wrong == []
    tab.evaluate("element('tones').value = 'AgX'; again()")
    until(tab, "element('bright').hidden")
    expected = Look(1.0, "AgX").shown(np.float32(light_of(tab, scene)), scene.exposure)
    assert np.abs(expected.astype(float) - pixels(tab)).max() <= 2
    tab.close()


def test_a_window_that_moves_to_a_plain_screen_maps_its_tones(gpu: Any, scene: Scene, tmp_path: Path) -> None:
    tab = opened(gpu, scene, tmp_path, HIGH + CANVAS)
    until(tab, "element('tones').value === 'HDR'")
    turn = "screenOfHdr.matches = {}; screenOfHdr.dispatchEvent(new Event('change'))"
    tab.evaluate(turn.format("false"))
    until(tab, "element('tones').value === 'AgX' && element('bright').hidden")
    assert tab.locator("#tones option").all_text_contents() == ["linear", "AgX", "filmic"]
    tab.evaluate(turn.format("true"))
    until(tab, "element('tones').value === 'HDR'")
    assert tab.wrong == []
    tab.close()


@pytest.mark.parametrize("before", ["", HIGH, HIGH + "delete Navigator.prototype.gpu"])
def test_without_an_hdr_screen_or_webgpu_tones_are_mapped(
    before: str, browser: Any, scene: Scene, tmp_path: Path
) -> None:
    tab = opened(browser, scene, tmp_path, before)
    expected = look_of(scene).shown(np.float32(light_of(tab, scene)), scene.exposure)
    assert np.abs(expected.astype(float) - pixels(tab)).max() <= 2
    assert tab.locator("#tones option").all_text_contents() == ["linear", "AgX", "filmic"]
    assert tab.locator("#bright").is_hidden()
    assert tab.wrong == []
    tab.close()
