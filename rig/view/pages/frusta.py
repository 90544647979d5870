"""The cameras of a scene's photographs, with what they took where the session is there."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import viser

from imaging.arrays import Array, Bytes
from imaging.errors import RigError
from imaging.session.paths import session_of
from recon.result.model import SceneView
from rig.view.pages.browser_cameras import motion_as_held
from rig.view.pictures.look import Look
from rig.view.pictures.painter import Painter
from rig.view.pictures.photographs import Photographs
from rig.view.serving.start_view import Start, height_angle, overview, pose_of

LENGTH = 0.06
"""Length of a camera, in units of the scene."""
NEAR = 5 * LENGTH
_TRAINED, _HELD_OUT = (90, 160, 255), (255, 140, 0)


class Frusta:
    """Shown to one browser. on_click: is given the name of the view."""

    def __init__(self, client: viser.ClientHandle, painter: Painter, on_click: Callable[[str], None]) -> None:
        self.client, self.painter, self.on_click = client, painter, on_click
        self.visible = False

    def show(self, look: Look) -> None:
        """All cameras at once, then their photographs, one after another, developed as `look` says."""
        self.visible = True
        for view in self.painter.scene.views:
            self._add(view, None)
        photographs = self._photographs()
        for view in self.painter.scene.views:
            if photographs is None or not self.visible:
                return
            if view.id in photographs.groups:
                light = photographs.read(view.id, view.orientation).light
                if light is not None and self.visible:
                    self._add(view, look.shown(light, self.painter.scene.exposure))

    def hide_the_scene_from(self, eye: Array) -> bool:
        """Return whether a camera is so near to the eye that its photograph would hide what is behind it."""
        scene = self.painter.scene
        centres = np.array([pose_of(motion_as_held(scene, view))[1] for view in scene.views])
        return bool(np.linalg.norm(centres - eye, axis=1).min() < NEAR)

    def overview(self) -> Start:
        """Place that overlooks all cameras."""
        scene = self.painter.scene
        return overview([motion_as_held(scene, view) for view in scene.views])

    def hide(self) -> None:
        """None of them."""
        self.visible = False
        for view in self.painter.scene.views:
            if self.client.scene.get_handle_by_name(_name(view)) is not None:
                self.client.scene.remove_by_name(_name(view))

    def _photographs(self) -> Photographs | None:
        """Photographs of the session of the scene; None without a readable session."""
        session = session_of(self.painter.scene.folder)
        try:
            return None if session is None or self.painter.scene.record.bands else Photographs(session)
        except RigError:
            return None

    def _add(self, view: SceneView, image: Bytes | None) -> None:
        wxyz, position = pose_of(motion_as_held(self.painter.scene, view))
        lens = view.lens.as_held(view.orientation)
        frustum = self.client.scene.add_camera_frustum(
            _name(view),
            height_angle(lens),
            lens.width / lens.height,
            scale=LENGTH,
            thickness=0.02 * LENGTH,
            color=_TRAINED if view.use == "training" else _HELD_OUT,
            image=image,
            wxyz=wxyz,
            position=position,
        )
        frustum.on_click(partial(self._clicked, view.name))

    def _clicked(self, name: str, _: Any) -> None:
        self.on_click(name)


def _name(view: SceneView) -> str:
    return f"/cameras/{view.name}"
