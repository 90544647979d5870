"""Viewers by others, run in headless Chromium on files that `rig` wrote: the pixels of their canvas.

A page of the tests draws by the viewer's own program, which `.ci/run` installs into `.judges`. Requests are
answered from the disk, and nothing is loaded from elsewhere.
"""

import base64
import io
import json
import math
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pytest
from PIL import Image

from imaging.arrays import Array, Bytes
from imaging.optics.pose import OPENGL_FROM_OPENCV
from recon.exports.target_coordinates import place_of
from recon.result.scene import Scene
from recon.splat import SplatCamera

MODULES = Path(__file__).parents[2] / ".judges" / "node_modules"
PAGES = Path(__file__).parent / "pages"
ORIGIN = "http://localhost:1/"
"""No server: Playwright answers in its place. Browsers trust a page of this machine as one of https."""
IMPORTS = {
    "playcanvas": "playcanvas/build/playcanvas.mjs",
    "three": "three/build/three.module.js",
    "three/addons/": "three/examples/jsm/",
    "three/tsl": "three/build/three.tsl.js",
    "three/webgpu": "three/build/three.webgpu.js",
    "@sparkjsdev/spark": "@sparkjsdev/spark/dist/spark.module.min.js",
    "@babylonjs/": "@babylonjs/",
    "@adobe/spz": "@adobe/spz/dist/spz.js",
    "fflate": "fflate/esm/browser.js",
}
PACKAGES = {
    "playcanvas": ("playcanvas",),
    "spark": ("@sparkjsdev/spark", "three"),
    "three": ("three",),
    "babylon": ("@babylonjs/core", "@babylonjs/loaders", "@adobe/spz", "fflate"),
}
"""Packages of each viewer."""
PAGE = """<!doctype html><meta charset="utf-8"><style>body {{ margin: 0; background: black }}</style>
<script type="importmap">{{"imports": {imports}}}</script>
<canvas width="{width}" height="{height}" style="width: {width}px; height: {height}px"></canvas>
<script type="module">
const canvas = document.querySelector("canvas");
window.draw = import("{origin}pages/{name}.js").then(({{ viewer }}) => viewer(canvas));
</script>"""
DRAW = "async (asked) => (await window.draw)(...asked)"
KINDS = {".js": "text/javascript", ".mjs": "text/javascript", ".wasm": "application/wasm"}
LIMIT = 120_000
"""Milliseconds that a browser without a GPU may take for a picture."""


def needs(viewer: str) -> pytest.MarkDecorator:
    """Skip where a viewer is not installed."""
    missing = [name for name in PACKAGES[viewer] if not (MODULES / name).is_dir()]
    return pytest.mark.skipif(
        bool(missing), reason=f"npm install --prefix .judges {' '.join(missing)} is not there"
    )


def turn_of(file: str, scene: Scene) -> Array:
    """Turn [4, 4] from the coordinates of a scene to those in which a viewer has a file.

    glTF stands level, SPZ has the axes of OpenGL. file: its name, or what that ends with.
    """
    turn = np.eye(4)
    if file.endswith("glb"):
        turn[:3, :3] = place_of(scene).turn
    return OPENGL_FROM_OPENCV if file.endswith("spz") else turn


class Viewer:
    """A tab of the browser with a viewer in it, whose canvas has this size, px."""

    def __init__(self, browser: Any, name: str, width: int, height: int) -> None:
        self.size = width, height
        self._page = PAGE.format(
            imports=json.dumps({module: f"{ORIGIN}modules/{path}" for module, path in IMPORTS.items()}),
            width=width,
            height=height,
            origin=ORIGIN,
            name=name,
        )
        self._wrong: list[str] = []
        self._tab = browser.new_page(viewport={"width": width, "height": height})
        self._tab.set_default_timeout(LIMIT)
        self._tab.on("pageerror", lambda error: self._wrong.append(str(error)))
        self._tab.on("console", lambda line: self._wrong.append(line.text) if line.type == "error" else None)
        self._tab.route(f"{ORIGIN}**", self._answer)
        self._tab.goto(ORIGIN)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._tab.close()

    def _answer(self, route: Any) -> None:
        folder, _, rest = route.request.url.removeprefix(ORIGIN).partition("/")
        if not folder:
            route.fulfill(body=self._page, content_type="text/html")
            return
        roots = {"modules": MODULES, "pages": PAGES, "files": Path("/")}
        path = roots.get(folder, PAGES) / rest
        if path.is_file():
            kind = KINDS.get(path.suffix, "application/octet-stream")
            route.fulfill(body=path.read_bytes(), content_type=kind)
        else:
            route.fulfill(status=404, body="")

    def drawn(
        self, file: Path, camera: SplatCamera, *, turn: Array | None = None, tones: str = "none"
    ) -> Bytes:
        """Draw a file: uint8 [H, W, 3], the pixels of the canvas.

        camera: a pinhole in the coordinates of the scene, with its axis in the middle and square pixels.
        turn: from these to the viewer's coordinates, [4, 4]. tones: the viewer's tone map.
        """
        assert (camera.width, camera.height) == self.size
        place = np.linalg.inv(camera.cam_from_world) @ OPENGL_FROM_OPENCV
        place = place if turn is None else turn @ place
        stand = {
            "matrix": place.T.ravel().tolist(),
            "fov": math.degrees(2 * math.atan(camera.height / 2 / camera.fy)),
            "near": 0.01,
            "far": 1000.0,
        }
        address = self._tab.evaluate(DRAW, [f"{ORIGIN}files{file.resolve()}", stand, tones])
        assert not self._wrong, self._wrong
        data = base64.b64decode(address.partition(",")[2])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))
