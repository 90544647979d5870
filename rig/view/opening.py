"""Scenes on disk become pages."""

from collections.abc import Sequence
from pathlib import Path

from recon.result.scene import open_scene
from rig.view.cameras import start_of
from rig.view.page import ScenePage
from rig.view.painter import Painter
from rig.view.server import Viewer


def show_scenes(viewer: Viewer, folders: Sequence[Path]) -> None:
    """Open one scene, or two to compare, and have a viewer show them."""
    scenes = [open_scene(folder) for folder in folders]
    scene, first = scenes[0], viewer.first
    start = start_of(scene, scene.views[0]) if first is None else first.start
    if first is None:
        viewer.begin_at(start)
    painter = Painter(*scenes)
    painter.warm_up()
    viewer.show(lambda client: ScenePage(client, painter, start))
