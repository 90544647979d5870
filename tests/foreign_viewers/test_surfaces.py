"""Points and meshes of `rig export` as three.js and Blender draw them, against the light that they are of."""

import json
from pathlib import Path

import numpy as np
import pytest

from imaging.arrays import Array
from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.files.exr.reading import read_exr
from imaging.optics.pose import OPENGL_FROM_OPENCV
from recon.exports.export import export
from recon.exports.request import FormatName
from recon.result.scene import Scene
from tests.foreign_viewers.python_programs import BLENDER, needs_blender, run
from tests.foreign_viewers.viewers import Viewer, needs
from tests.foreign_viewers.wall import FOCAL, HEIGHT, RADIANCES, TINT, WIDTH, front, strips

LIGHT = np.array(RADIANCES)[:, None] * np.ones(3)


def stepped(light: Array) -> Array:
    """Codes of light that three.js rounds to 8 bits, of the codes that a file has."""
    codes = np.round(255 * srgb_encode(light.clip(max=1)))
    return 255 * srgb_encode(np.round(255 * srgb_decode(codes / 255)) / 255)


@needs("three")
@pytest.mark.parametrize("kind", ["points", "mesh"])
def test_the_radiances_of_the_wall_are_seen_in_three(
    kind: FormatName, wall: Scene, browser: object, files: Path
) -> None:
    export(wall, files / f"{kind}.ply", kind, exposure=0.0)
    with Viewer(browser, "three_surfaces", WIDTH, HEIGHT) as viewer:
        codes = viewer.drawn(files / f"{kind}.ply", front())
    upper, lower = strips(codes.astype(float))
    assert np.abs(upper - stepped(LIGHT)).max() < 1
    assert np.abs(lower - stepped(LIGHT * TINT)).max() < 3


@needs_blender
def test_a_mesh_emits_the_radiances_of_the_wall_in_blender(wall: Scene, tmp_path: Path) -> None:
    export(wall, tmp_path / "mesh.ply", "mesh", exposure=0.0)
    asked = {
        "file": str(tmp_path / "mesh.ply"),
        "size": (WIDTH, HEIGHT),
        "lens": 36 * FOCAL / WIDTH,
        "to_world": (np.linalg.inv(front().cam_from_world) @ OPENGL_FROM_OPENCV).tolist(),
        "out": str(tmp_path / "mesh.exr"),
    }
    (tmp_path / "asked.json").write_text(json.dumps(asked))
    run(BLENDER, "blender_mesh.py", tmp_path / "asked.json")
    drawn = read_exr(tmp_path / "mesh.exr").rgb()
    upper, lower = strips(drawn)
    assert np.abs(np.log2(upper / LIGHT)).max() < 0.01
    assert np.abs(np.log2(lower / (LIGHT * TINT))).max() < 0.15  # next to brighter rows
