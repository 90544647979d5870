"""Cameras of USD and Alembic files as Blender has them, against the views that they are of."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.exports.export import export
from recon.exports.formats import alembic
from recon.exports.target_coordinates import pinhole, place_of
from recon.result.scene import Scene
from tests.foreign_viewers.python_programs import BLENDER, needs_blender, run
from tests.foreign_viewers.wall import HEIGHT, WIDTH

pytestmark = needs_blender
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From a stage with y up to Blender's axes."""


@pytest.mark.parametrize(("width", "height"), [(WIDTH, HEIGHT), (HEIGHT, WIDTH)])
@pytest.mark.parametrize("name", ["scene.usdc", "scene.abc"])
def test_cameras_of_blender_see_points_where_the_views_see_them(
    wall: Scene, tmp_path: Path, name: str, width: int, height: int
) -> None:
    lens = {"width": width, "height": height, "cx": width / 2 + 9, "cy": height / 2 - 5}
    views = tuple(view.model_copy(update={"lens": view.lens.model_copy(update=lens)}) for view in wall.views)
    wall = replace(wall, record=wall.record.model_copy(update={"views": views}))
    points = np.random.default_rng(0).uniform((-3, -0.6, -0.5), (3, 0.6, 0.5), (12, 3))
    if name.endswith(".abc"):
        alembic.write_cameras(tmp_path / name, wall, place_of(wall))
    else:
        export(wall, tmp_path / name)
    asked = {
        "file": str(tmp_path / name),
        "size": (width, height),
        "frames": [view.frame for view in wall.views],
        "points": ((points - wall.record.offset) @ (Z_UP @ place_of(wall).turn).T).tolist(),
    }
    (tmp_path / "asked.json").write_text(json.dumps(asked))
    run(BLENDER, "blender_cameras.py", tmp_path / "asked.json", tmp_path / "answer.json")
    (camera,) = json.loads((tmp_path / "answer.json").read_text()).values()
    for view in wall.views:
        straight = pinhole(view.splat_camera)
        assert camera["sensor"] == pytest.approx(36, rel=1e-5)
        assert camera["lens"] == pytest.approx(36 * straight.fx / width, rel=1e-5)
        x, y, z = straight.cam_from_world[:3, :3] @ points.T + straight.cam_from_world[:3, 3:]
        pixels = np.column_stack([straight.fx * x / z + straight.cx, straight.fy * y / z + straight.cy])
        assert np.abs(np.array(camera["frames"][str(view.frame)]) - pixels).max() < 0.01
