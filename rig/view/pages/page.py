"""Page of a scene in one browser: the picture of its own camera, and the controls beside it."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Literal

import numpy as np
import torch
import viser

from imaging.arrays import Bytes
from imaging.errors import RigError
from rig.view.pages.browser_cameras import splat_camera, start_of
from rig.view.pages.controls import AIM, DIFFERENCE_STOPS, FREE, Controls, assign
from rig.view.pages.frusta import Frusta
from rig.view.pictures.layers import LAYERS, TRUST, picture_of
from rig.view.pictures.look import CURVES, Look, coloured, stops
from rig.view.pictures.meter import reading
from rig.view.pictures.painter import DIFFERENCE, OVER, Drawing, Painter, Wanted, measured
from rig.view.serving.frame import Frame, marked
from rig.view.serving.start_view import Start, point, stand
from rig.view.serving.state import State
from rig.view.serving.window import Window

COARSE_SECONDS = 0.028
"""Time of a picture while the camera moves: it has as few pixels as that needs."""
STILL_SECONDS = 0.15
"""Time after which a camera that did not move is shown at full size."""
ARRIVAL_SECONDS = 0.5
"""Time in which a browser reports its place after it was sent to a view: upright, as that may not be."""
LOADING_SECONDS = 5.0
"""The same, of one that has just been opened by the address of a view."""
MOST_WIDTH, SOON_WIDTH, LEAST_WIDTH = 8192, 1280, 160
"""Widths of pictures, px: at most, soon after the camera stopped, and at least while it moves."""
_SAME = 1e-4
"""Smallest movement of a camera, in units of the scene."""


class ScenePage:
    """Draws for one browser, in a thread of its own, until it is closed."""

    def __init__(
        self, client: viser.ClientHandle, painter: Painter, start: Start, look: Look, window: Window
    ) -> None:
        self.client, self.painter, self.start = client, painter, start
        self.frame: Frame | None = None
        self._drawing: Drawing | None = None
        self._drawn: object = None
        self._spot: tuple[float, float] | None = None
        self._centre = 0.5, 0.5
        self._measured: tuple[Drawing | None, object] = None, None
        self._wake, self._closed = threading.Event(), threading.Event()
        self._moved = self._arrived = self._settled = 0.0
        self._stood = np.zeros(7)
        self._pixels_a_second = 2e6
        self._frusta = Frusta(client, painter, lambda name: assign(self.controls.view, name))
        self.controls = Controls(
            client.gui,
            painter,
            look,
            self._wake.set,
            window=window,
            on_view=self._go,
            on_pixels=self._show_pixels,
            on_frusta=self._show_frusta,
            on_home=self._go_home,
        )
        client.camera.on_update(lambda _: self._camera_moved())
        client.scene.on_click()(lambda event: self._aim(*event.screen_pos))
        self._thread = threading.Thread(target=self._run, name=f"page {client.client_id}", daemon=True)
        self._thread.start()
        self._wake.set()

    @property
    def look(self) -> Look:
        """Chosen look."""
        return self.controls.look

    def tell(self, text: str) -> None:
        """Show the state of a training."""
        self.controls.note.say(text)

    def refresh(self) -> None:
        """Draw again: the painter has another scene, or more is known of it."""
        self._drawn = None
        self._wake.set()

    def restore(self, state: State) -> None:
        """Stand where an address says, or at the view that it names, and show what it names."""
        view = state.view if state.view in self.controls.view.options else FREE
        self._settled = time.monotonic() + LOADING_SECONDS
        if view != FREE:
            assign(self.controls.view, view)
            self.controls.offer(view)
        elif state.start is not None:
            self._stand(state.start)
        if state.show in self.controls.show.options:
            assign(self.controls.show, state.show)
        if state.centre is not None and view != FREE:
            assign(self.controls.pixels, True)
            self._centre = state.centre
        self._wake.set()

    def _state(self) -> State:
        """State for the address."""
        camera, view = self.client.camera, self.controls.view.value
        start = None
        if view == FREE:
            eye, ahead, up = point(camera.position), point(camera.look_at), point(camera.up_direction)
            start = Start(eye, ahead, up, camera.fov)
        centre = self._centre if self._pixel_for_pixel else None
        return State(self.look, "" if view == FREE else view, self.controls.show.value, start, centre)

    @property
    def _pixel_for_pixel(self) -> bool:
        return bool(self.controls.pixels.value) and self.controls.view.value != FREE

    def close(self) -> None:
        """The browser is gone, or has another page."""
        self._closed.set()
        self._frusta.visible = False
        self._wake.set()
        self._thread.join()

    def clear(self) -> None:
        """Remove the cameras."""
        self._frusta.hide()

    def _go(self, name: str) -> None:
        """Move the camera to a view, with its lens, until it is moved."""
        self.controls.offer(None if name == FREE else name)
        if name != FREE:
            scene = self.painter.scene
            self._stand(start_of(scene, scene.view(name)))
        self._wake.set()

    def _go_home(self) -> None:
        assign(self.controls.view, FREE)
        self._stand(self.start)

    def _stand(self, start: Start) -> None:
        camera = self.client.camera
        self._arrived = time.monotonic()
        self._stood = np.concatenate([camera.wxyz, camera.position])
        stand(self.client, start)

    def _camera_moved(self) -> None:
        self._moved = time.monotonic()
        if self.controls.view.value != FREE:
            here = np.concatenate([self.client.camera.wxyz, self.client.camera.position])
            if self._moved - self._arrived < ARRIVAL_SECONDS or self._moved < self._settled:
                self._stood = here
            elif np.abs(here - self._stood).max() > _SAME:
                assign(self.controls.view, FREE)
        self._wake.set()

    def _show_frusta(self, visible: bool) -> None:
        if visible:
            if self._frusta.hide_the_scene_from(self.client.camera.position):
                assign(self.controls.view, FREE)
                self._stand(self._frusta.overview())
            self._frusta.show(self.controls.look)
        else:
            self._frusta.hide()

    def _run(self) -> None:
        """Coarse pictures while the camera moves, and one at full size when it has stopped."""
        torch.set_num_threads(1)  # of this thread's operations: waking others costs more than they save
        while True:
            self._wake.wait()
            moving = time.monotonic() - self._moved < STILL_SECONDS
            self._wake.clear()
            if self._closed.is_set():
                return
            self._show(coarse=moving)
            for most in (SOON_WIDTH, MOST_WIDTH) if moving else ():
                if self._wake.wait(STILL_SECONDS) or self._closed.is_set():
                    break
                if most == SOON_WIDTH or self._drawn != (self._wanted(False).key, self.client.camera.aspect):
                    self._show(coarse=False, most=most)

    def _show(self, coarse: bool, most: int = MOST_WIDTH) -> None:
        try:
            self._send(coarse, most)
        except RigError as error:
            self.client.add_notification("Nothing to show", str(error), color="red", auto_close_seconds=15)

    def _send(self, coarse: bool, most: int) -> None:
        began, camera = time.perf_counter(), self.client.camera
        wanted = self._wanted(coarse, most)
        key = wanted.key, camera.aspect
        if self._drawing is None or key != self._drawn:
            with self._shown_while(wanted):
                self._drawing, self._drawn = self.painter.draw(wanted), key
        exact = self._pixel_for_pixel
        window = (camera.image_width, camera.image_height) if exact else None
        self.frame = Frame(self._drawing.light, camera.aspect, window, self._centre)
        shown, spot = self.frame.in_window(self._picture(self._drawing, wanted.show)), self._spot
        if spot is not None:
            shown = marked(shown, *spot)
        if self._closed.is_set():
            return
        self.controls.bright.clear()
        kind: Literal["png", "jpeg"] = "png" if exact else "jpeg"
        self.client.scene.set_background_image(shown, format=kind, jpeg_quality=75 if coarse else 95)
        place = None if spot is None else self.frame.pixel(*spot)
        if spot is not None and (self._measured[0] is not self._drawing or self._measured[1] != place):
            self._measure(self._drawing, place, wanted.show, coarse)
            if not coarse:
                self._measured = self._drawing, place
        if not coarse:
            self.controls.state.content = self._state().element
        self.client.flush()
        if not coarse and self._is_bright(self._drawing, wanted.show) and not self._wake.is_set():
            factor = np.float32(self.painter.scene.exposure * 2.0**self.controls.look.exposure)
            light = self.frame.in_window(self._drawing.light * factor)
            self.controls.bright.show(light if spot is None else marked(light, *spot))
            self.client.flush()
        rate = shown.shape[0] * shown.shape[1] / max(time.perf_counter() - began, 1e-4)
        if coarse:
            self._pixels_a_second += 0.3 * (rate - self._pixels_a_second)

    @contextmanager
    def _shown_while(self, wanted: Wanted) -> Iterator[None]:
        """Show the present work while it takes longer than a picture."""
        if wanted.show != TRUST or self.painter.trust_is_known:
            yield
            return
        title = "Looking at what each photograph saw"
        notice = self.client.add_notification(title, "", loading=True, with_close_button=False)
        self.client.flush()
        try:
            yield
        finally:
            notice.remove()

    def _wanted(self, coarse: bool, most: int = MOST_WIDTH) -> Wanted:
        camera, controls = self.client.camera, self.controls
        name = controls.view.value
        view = None if name == FREE else name
        shows = self.painter.shows(view)
        # Another thread may have left the view, and not taken back yet what only a view has.
        show = controls.show.value if controls.show.value in shows else shows[0]
        full = min(most, camera.image_width or 640)
        width = full
        if coarse:
            affordable = np.sqrt(self._pixels_a_second * COARSE_SECONDS * camera.aspect)
            width = int(np.clip(affordable, min(LEAST_WIDTH, full), full))
        lens = splat_camera(camera, width) if view is None else self.painter.placed(view)
        return Wanted(show, view, lens, controls.parts)

    def _picture(self, drawing: Drawing, show: str) -> Bytes:
        scale = self.painter.scene.exposure
        if drawing.layer is not None and show in LAYERS:
            return picture_of(show, drawing.layer, self.painter.scene)
        if show in (DIFFERENCE, OVER) and drawing.over is not None:
            return coloured(stops(drawing.light, scale) - stops(drawing.over, scale), DIFFERENCE_STOPS)
        look = self.controls.look
        return (replace(look, tones="linear") if self._is_bright(drawing, show) else look).shown(
            drawing.light, scale
        )

    def _is_bright(self, drawing: Drawing, show: str) -> bool:
        """Return whether light itself is shown, on an HDR screen."""
        plain = drawing.layer is None and show not in (DIFFERENCE, OVER)
        return bool(self.controls.hdr.value) and plain and self.controls.look.tones in CURVES

    def _aim(self, across: float, down: float) -> None:
        """Measure at a place in the window, 0..1, from now on; pixel for pixel bring it to the middle."""
        self._spot = across, down
        if self._pixel_for_pixel:
            self._show_pixels(True)
        self._wake.set()

    def _show_pixels(self, exact: bool) -> None:
        """Bring the spot, if any, to the middle of a view that is shown pixel for pixel."""
        if exact and self.frame is not None and self._spot is not None:
            if (place := self.frame.pixel(*self._spot)) is not None:
                height, width = self.frame.light.shape[:2]
                self._centre = (place[1] + 0.5) / width, (place[0] + 0.5) / height
            self._spot = 0.5, 0.5
        self._wake.set()

    def _measure(self, drawing: Drawing, place: tuple[int, int] | None, show: str, coarse: bool) -> None:
        """Show the light at a pixel; None: the spot lies beside the picture."""
        if place is None:
            self.controls.spot.content = AIM
            return
        self.controls.spot.content = reading(drawing, show, self.painter.scene, *place)
        if coarse:
            return
        number = measured(show, place[1], drawing.light.shape[1])
        if number is None:
            return
        self.client.flush()
        residuals = self.painter.residuals(number)  # the first time it takes a while
        if residuals is not None and not self._closed.is_set():
            self.controls.spot.content = reading(drawing, show, self.painter.scene, *place, residuals)
