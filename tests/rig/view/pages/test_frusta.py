"""The cameras of photographs in a page."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imaging.session.paths import find_reconstruction
from recon.result.scene import open_scene
from rig.view.pages.browser_cameras import start_of
from rig.view.pages.frusta import Frusta
from rig.view.pictures.look import Look
from rig.view.pictures.painter import Painter


@pytest.mark.parametrize("orientation", [1, 6])
def test_photographs_stand_upright_in_their_cameras(scene_template, orientation: int) -> None:
    """Of a photograph that was held so, the left side is up, and its file may state nothing."""
    scene = open_scene(find_reconstruction(scene_template))
    views = tuple(view.model_copy(update={"orientation": orientation}) for view in scene.views)
    scene = replace(scene, record=scene.record.model_copy(update={"views": views}))
    added: dict[str, SimpleNamespace] = {}

    def add(name: str, fov: float, aspect: float, **rest: object) -> SimpleNamespace:
        added[name] = SimpleNamespace(aspect=aspect, on_click=lambda _: None, **rest)
        return added[name]

    client = SimpleNamespace(scene=SimpleNamespace(add_camera_frustum=add))
    frusta = Frusta(client, Painter(scene), print)
    frusta.show(Look())
    for view in views:
        shown, turn = added[f"/cameras/{view.name}"], view.cam_from_world.matrix()[:3, :3]
        height, width = shown.image.shape[:2]
        assert shown.aspect == pytest.approx(width / height, rel=0.02)
        up = Rotation.from_quat(shown.wxyz, scalar_first=True).apply((0, -1, 0))
        np.testing.assert_allclose(up, -turn[1] if orientation == 1 else -turn[0], atol=1e-9)
    np.testing.assert_allclose(frusta.overview().up, start_of(scene, views[0]).up, atol=1e-9)
