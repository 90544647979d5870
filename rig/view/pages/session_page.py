"""Page of a session without a scene in one browser: its photographs, and its rig once calibrated."""

import threading
from functools import partial
from pathlib import Path

import numpy as np
import viser

from imaging.errors import InputError
from imaging.session.view_id import ViewId
from recon.result.first_look import shot_at
from rig.view.pages.controls import assign
from rig.view.pages.note import Note
from rig.view.pages.rig_model import RigModel
from rig.view.pictures.look import MIDDLE_GREY, TONE_MAPS, Look, first_look
from rig.view.pictures.photographs import Photograph, Photographs, in_words, labelled, sheet
from rig.view.serving.frame import Frame
from rig.view.serving.server import Viewer
from rig.view.serving.start_view import height_angle, pose_of, stand
from rig.view.serving.state import State
from rig.view.serving.window import Window

PHOTOGRAPHS, RIG = "photographs", "rig"
SHEET = 1000
"""Width that a contact sheet is sent with, at least about, px."""
FRUSTUM = 0.12
"""Length of a camera, in page units."""


class SessionPage:
    """A contact sheet, developed at the page's exposure, and the rig in three dimensions."""

    def __init__(
        self,
        client: viser.ClientHandle,
        photographs: Photographs,
        rig: RigModel | None,
        look: Look,
        window: Window,
    ) -> None:
        self.client, self.photographs, self.rig = client, photographs, rig
        self.frame: Frame | None = None
        self.read: dict[ViewId, Photograph] = {}
        self._scale = 1.0
        self._wake, self._closed = threading.Event(), threading.Event()
        gui = client.gui
        self._note = Note(gui)
        with gui.add_folder("Look"):
            hint = "At 0 the median of the photographs is middle grey."
            self.exposure = gui.add_slider("Exposure, stops", -16.0, 16.0, 0.1, look.exposure, hint=hint)
            self.tones = gui.add_dropdown("Tones", TONE_MAPS, initial_value=look.tones)
            shows = (PHOTOGRAPHS, RIG) if rig else (PHOTOGRAPHS,)
            self.show = gui.add_dropdown("Show", shows, visible=rig is not None)
        with gui.add_folder("Session", expand_by_default=not window.narrow):
            self.words = gui.add_markdown("")
        self._state = gui.add_html("")
        for control in (self.exposure, self.tones, self.show):
            control.on_update(lambda _: self._wake.set())
        client.camera.on_update(lambda _: self._reshaped())
        self._thread = threading.Thread(target=self._run, name=f"page {client.client_id}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """The browser is gone."""
        self._closed.set()
        self._wake.set()
        self._thread.join()

    def clear(self) -> None:
        """Remove the rig."""
        self._hide_rig()

    @property
    def look(self) -> Look:
        """Chosen look."""
        return Look(float(self.exposure.value), self.tones.value)

    def restore(self, state: State) -> None:
        """Show what an address names."""
        if state.show in self.show.options:
            assign(self.show, state.show)
        self._wake.set()

    def tell(self, text: str) -> None:
        """Show the state of a training."""
        self._note.say(text)

    def refresh(self) -> None:
        """Do nothing: it shows no scene."""

    def _reshaped(self) -> None:
        """Only another shape of the window changes a contact sheet."""
        if self.frame is not None and self.frame.aspect != self.client.camera.aspect:
            self._wake.set()

    def _run(self) -> None:
        count = len(self.photographs)
        notice = self.client.add_notification("Reading the photographs", "", loading=True)
        for done, view in enumerate(self.photographs.groups):
            if self._closed.is_set():
                return
            self.read[view] = self.photographs.read(view)
            notice.body = f"{done + 1} of {count}"
            if done in (0, 3) or done % 8 == 7:
                self._send()
        notice.remove()
        self._send()
        while True:
            self._wake.wait()
            self._wake.clear()
            if self._closed.is_set():
                return
            self._send()

    def _send(self) -> None:
        lights = [one.light for one in self.read.values() if one.light is not None]
        self._tell()
        if not lights or self._closed.is_set():
            return
        lit = np.concatenate([light[light > 0] for light in lights])
        self._scale = float(MIDDLE_GREY / np.median(lit)) if lit.size else 1.0
        if self.show.value == RIG:
            self.client.scene.set_background_image(None)
            self._show_rig()
        else:
            self._hide_rig()
            self._show_sheet([one for one in self.read.values() if one.light is not None])
        self._state.content = State(self.look, show=self.show.value).element
        self.client.flush()

    def _show_sheet(self, photographs: list[Photograph]) -> None:
        aspect = self.client.camera.aspect
        lights = [one.light for one in photographs if one.light is not None]
        shape = lights[0].shape
        columns = max(1, round(np.sqrt(aspect * len(self.photographs) * shape[0] / shape[1])))
        columns = min(columns, len(self.photographs))
        light = sheet(lights, columns)
        self.frame = Frame(light, aspect)
        names = [str(one.view) for one in photographs]
        shown = self.frame.in_window(labelled(self.look.shown(light, self._scale), names, columns))
        larger = max(1, SHEET // shown.shape[1])  # or JPEG would blur the colours of small ones
        shown = shown.repeat(larger, axis=0).repeat(larger, axis=1)
        self.client.scene.set_background_image(shown, format="jpeg", jpeg_quality=92)

    def _show_rig(self) -> None:
        assert self.rig is not None
        rig, scene = self.rig, self.client.scene
        if scene.get_handle_by_name("/rig/points") is None:
            scene.add_point_cloud("/rig/points", rig.points, rig.colours, point_size=0.008)
            stand(self.client, rig.start())
        for view, placed in rig.poses.items():
            photograph = self.read.get(view)
            lens, light = rig.lenses[view], None if photograph is None else photograph.light
            wxyz, position = pose_of(placed)
            frustum = scene.add_camera_frustum(
                f"/rig/{view}",
                height_angle(lens),
                lens.width / lens.height,
                scale=FRUSTUM,
                thickness=0.02 * FRUSTUM,
                color=(90, 160, 255),
                image=None if light is None else self.look.shown(light, self._scale),
                wxyz=wxyz,
                position=position,
            )
            frustum.on_click(partial(self._stand_at, view))

    def _hide_rig(self) -> None:
        if self.rig is not None and self.client.scene.get_handle_by_name("/rig/points") is not None:
            self.client.scene.remove_by_name("/rig")

    def _stand_at(self, view: ViewId, _: object) -> None:
        assert self.rig is not None
        stand(self.client, self.rig.start(view))

    def _tell(self) -> None:
        content = self.rig.words() if self.rig is not None and self.show.value == RIG else self._list()
        if content != self.words.content:
            self.words.content = content

    def _list(self) -> str:
        count = len(self.photographs)
        state = "not calibrated" if self.photographs.calibration is None else "calibrated"
        return "  \n".join([f"{count} views, {state}", *in_words(self.read.values())])


def show_session(viewer: Viewer, folder: Path) -> None:
    """Let a viewer show a session before it has a scene: its photographs, and its rig if it has poses."""
    photographs = Photographs(folder)
    if not photographs.groups:
        raise InputError(f"{folder} has no photographs of a scene: capture or import some first.")
    rig = RigModel.of(photographs)
    start = None if rig is None else rig.start()
    shots = [[(shot.file, 1.0) for shot in group] for group in photographs.groups.values()]
    look = first_look(1.0, shot_at(shots))
    viewer.show(lambda client, look, window: SessionPage(client, photographs, rig, look, window), look, start)
