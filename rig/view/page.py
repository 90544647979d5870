"""What one browser sees of a scene: the picture of its own camera, and the controls beside it."""

import threading
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import viser

from imaging.files.exr import read_exr
from recon.result.display import in_colour
from recon.result.model import SceneView
from recon.result.scene import Scene
from recon.splat import SplatCamera
from rig.terminal.text import number
from rig.view.cameras import field_of_view, pose, splat_camera
from rig.view.frame import Frame
from rig.view.look import LUMINANCE, STOPS, TONE_MAPS, Light, Look, Picture, coloured, legend, stops

COARSE_SECONDS = 0.025
"""That a picture may take while the camera moves: it has as few pixels as that needs."""
STILL_SECONDS = 0.15
"""After which a camera that did not move is shown at full size."""
ARRIVAL_SECONDS = 0.5
"""In which a browser says where it stands after it was sent to a view: upright, as that may not be."""
MOST_WIDTH, LEAST_WIDTH = 1280, 160
FREE = "free"
RENDER, REFERENCE, DIFFERENCE = "render", "reference", "difference"
DIFFERENCE_STOPS = 2.0
"""At the ends of the colours of a difference."""
_SAME = 1e-4
"""In units of the scene: a camera that is moved by less is where it was."""


class Page:
    """Draws for one browser, in a thread of its own, until it is closed.

    references: linear light of views that were held out, EXR by name of the view. drawing: held by who
    renders, since the kernels share all cores.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        scene: Scene,
        references: Mapping[str, Path],
        drawing: threading.Lock,
    ) -> None:
        self.client, self.scene, self.references, self.drawing = client, scene, references, drawing
        self.frame: Frame | None = None
        self._drawn: object = None
        self._wake, self._closed = threading.Event(), threading.Event()
        self._moved = self._arrived = 0.0
        self._stood = np.zeros(7)
        self._pixels_a_second = 2e6
        self._make_controls()
        client.camera.on_update(lambda _: self._camera_moved())
        client.scene.on_click()(lambda event: self._measure(*event.screen_pos))
        self._thread = threading.Thread(target=self._run, name=f"page {client.client_id}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """The browser is gone."""
        self._closed.set()
        self._wake.set()
        self._thread.join()

    def _make_controls(self) -> None:
        gui = self.client.gui
        with gui.add_folder("Look"):
            hint = "At 0 the median of the scene is middle grey."
            self._exposure = gui.add_slider("Exposure, stops", -16.0, 16.0, 0.1, 0.0, hint=hint)
            self._tones = gui.add_dropdown("Tones", TONE_MAPS)
            self._legend = gui.add_image(legend(), label=_legend_label(False), visible=False)
        with gui.add_folder("Cameras"):
            self._view = gui.add_dropdown("View", (FREE, *(view.name for view in self.scene.views)))
            hint = "Of views that were held out and evaluated."
            self._shown = gui.add_dropdown("Show", (RENDER, REFERENCE, DIFFERENCE), visible=False, hint=hint)
            self._frusta = gui.add_checkbox("Cameras of the photographs", False)
        with gui.add_folder("Spot meter"):
            self._spot = gui.add_markdown("Click into the picture.")
        self._exposure.on_update(lambda _: self._wake.set())
        self._tones.on_update(lambda _: self._choose_tones())
        self._shown.on_update(lambda _: self._choose_tones())
        self._view.on_update(lambda _: self._go(self._view.value))
        self._frusta.on_update(lambda _: self._show_frusta(self._frusta.value))

    def _choose_tones(self) -> None:
        compared = self._shown.value == DIFFERENCE
        self._legend.visible = compared or self._tones.value == "false colour"
        self._legend.label = _legend_label(compared)
        self._wake.set()

    def _go(self, name: str) -> None:
        """Look from where a view does, through its lens, until the camera is moved."""
        _assign(self._shown, RENDER)
        self._shown.visible = name in self.references
        if name != FREE:
            view = self.scene.view(name)
            camera = self.client.camera
            self._arrived = time.monotonic()
            self._stood = np.concatenate([camera.wxyz, camera.position])
            _, position = pose(self._placed(view))
            with self.client.atomic():
                camera.position = position
                camera.look_at = position + self._placed(view).cam_from_world[2, :3]
                camera.up_direction = self.scene.up
                camera.fov = field_of_view(view)
        self._wake.set()

    def _placed(self, view: SceneView) -> SplatCamera:
        """A view's camera in the coordinates of the scene."""
        return self.scene.record.world.camera(view.splat_camera)

    def _camera_moved(self) -> None:
        self._moved = time.monotonic()
        if self._view.value != FREE:
            here = np.concatenate([self.client.camera.wxyz, self.client.camera.position])
            if self._moved - self._arrived < ARRIVAL_SECONDS:
                self._stood = here
            elif np.abs(here - self._stood).max() > _SAME:
                _assign(self._view, FREE)
        self._wake.set()

    def _show_frusta(self, visible: bool) -> None:
        for view in self.scene.views:
            name = f"/cameras/{view.name}"
            if not visible:
                self.client.scene.remove_by_name(name)
                continue
            wxyz, position = pose(self._placed(view))
            held_out = view.use != "training"
            frustum = self.client.scene.add_camera_frustum(
                name,
                field_of_view(view),
                view.lens.width / view.lens.height,
                scale=0.06,
                color=(255, 140, 0) if held_out else (90, 160, 255),
                wxyz=wxyz,
                position=position,
            )
            frustum.on_click(partial(self._stand_at, view.name))

    def _stand_at(self, name: str, _: Any) -> None:
        _assign(self._view, name)

    def _run(self) -> None:
        """Coarse pictures while the camera moves, and one at full size when it has stopped."""
        while True:
            self._wake.wait()
            moving = time.monotonic() - self._moved < STILL_SECONDS
            self._wake.clear()
            if self._closed.is_set():
                return
            self._show(coarse=moving)
            if moving and not self._wake.wait(STILL_SECONDS) and not self._closed.is_set():
                self._show(coarse=False)

    def _show(self, coarse: bool) -> None:
        look = Look(float(self._exposure.value), self._tones.value)
        picture = look.shown(self._light(coarse).light, self.scene.exposure)
        assert self.frame is not None
        if self._shown.value == DIFFERENCE:
            picture = self._difference(self.frame.light)
        shown = self.frame.in_window(picture)
        self.client.scene.set_background_image(shown, format="jpeg", jpeg_quality=75 if coarse else 95)
        self.client.flush()

    def _light(self, coarse: bool) -> Frame:
        """What is to be shown, drawn anew unless it was drawn just so."""
        camera, name = self.client.camera, self._view.value
        full = min(MOST_WIDTH, camera.image_width or 640)
        width = full
        if coarse:
            affordable = np.sqrt(self._pixels_a_second * COARSE_SECONDS * camera.aspect)
            width = int(np.clip(affordable, min(LEAST_WIDTH, full), full))
        if name == FREE:
            wanted = splat_camera(camera, width)
        else:
            wanted = self._placed(self.scene.view(name))
        key = (wanted.cam_from_world.tobytes(), wanted.lens, wanted.width, camera.aspect, self._shown.value)
        if self.frame is None or key != self._drawn:
            if self._shown.value == REFERENCE:
                light = _read(self.references[name])
            else:
                light = self._render(wanted)
            self.frame, self._drawn = Frame(light, camera.aspect), key
        return self.frame

    def _render(self, camera: SplatCamera) -> Light:
        with self.drawing:
            began = time.perf_counter()
            light = self.scene.render(self.scene.record.world.camera_in_world(camera))
            rate = camera.width * camera.height / max(time.perf_counter() - began, 1e-4)
        self._pixels_a_second += 0.3 * (rate - self._pixels_a_second)
        return in_colour(light, self.scene.record.bands)

    def _difference(self, light: Light) -> Picture:
        """Stops by which a render is brighter than its reference, in colours."""
        reference = _read(self.references[self._view.value])
        if reference.shape != light.shape:
            reference = cv2.resize(reference, light.shape[1::-1], interpolation=cv2.INTER_AREA)
        scale = self.scene.exposure
        brighter = stops(light, scale) - stops(np.asarray(reference, np.float32), scale)
        return coloured(brighter, DIFFERENCE_STOPS)

    def _measure(self, across: float, down: float) -> None:
        """Say what light there is at a place in the window, 0..1."""
        frame = self.frame
        place = None if frame is None else frame.pixel(across, down)
        if frame is None or place is None:
            return
        colour = frame.light[place]
        luminance = float(colour @ LUMINANCE)
        above = float(stops(colour, self.scene.exposure))
        lines = [
            f"**{above:+.2f} stops** from middle grey",
            f"luminance {number(luminance)}",
            "R, G, B " + ", ".join(number(float(value)) for value in colour),
            f"column {place[1]}, row {place[0]} of {frame.light.shape[1]}x{frame.light.shape[0]}",
        ]
        if self.scene.luminance_scale is not None and self.scene.luminance_error is not None:
            share = self.scene.luminance_error / self.scene.luminance_scale
            absolute = luminance * self.scene.luminance_scale
            lines.insert(1, f"**{number(absolute)} cd/m2** +- {number(100 * share)} %")
        self._spot.content = "  \n".join(lines)


def _legend_label(compared: bool) -> str:
    most, of = (DIFFERENCE_STOPS, "above the reference") if compared else (STOPS, "above middle grey")
    return f"-{most:g} to +{most:g} stops {of}"


def _assign(control: Any, value: object) -> None:
    """Set a control, and the browser's: viser annotates values as if they could only be read."""
    control.value = value


def _read(path: Path) -> Light:
    """Linear light of an EXR, float32 [H, W, 3]."""
    planes = read_exr(path).channels
    return np.dstack([planes[name] for name in "RGB"]).astype(np.float32)
