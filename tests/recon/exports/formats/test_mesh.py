"""Meshes, read by trimesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from imaging.colour.spaces import srgb_encode
from imaging.errors import ReconstructionError
from recon.exports.export import export
from recon.exports.formats import mesh
from recon.result.environment_files import evenly
from recon.result.scene import Scene, open_scene
from recon.scene.gaussians import Gaussians
from tests.recon.exports.made_scene import WORLD, write_made
from tests.recon.ply_files import read_ply

RADIUS = 0.5
"""In scene units."""
GREY = 40.0
"""Radiance of the sphere's upper half; that of the lower is 2^10 times less."""


@pytest.fixture(scope="module")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Opaque Gaussians on a sphere, flat, seen from all around."""
    scene = open_scene(write_made(tmp_path_factory.mktemp("sphere"), bent=False, frames=16))
    directions = evenly(1500)
    x, y, z = directions.T
    light = np.where(directions[:, :1] > 0, GREY, GREY / 1024).repeat(3, 1) / scene.record.normaliser
    parameters = {
        "means": RADIUS * directions,
        "log_scales": np.tile(np.log([0.04, 0.04, 0.004]), (1500, 1)),
        "quats": np.column_stack([1 + z, -y, x, 0 * z]),
        "opacity_logits": np.full(1500, 20.0),
    }
    tensors = {name: torch.from_numpy(value.astype(np.float32)) for name, value in parameters.items()}
    tensors |= scene.renderer.appearance.start(torch.from_numpy(light.astype(np.float32)))
    renderer = replace(scene.renderer, sampling=None)
    return replace(scene, gaussians=Gaussians(tensors), renderer=renderer)


def test_a_sphere_is_a_sphere_in_linear_light(
    sphere: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh, "CELLS", 48)
    exported = export(sphere, tmp_path / "mesh.ply", "mesh")
    surface = trimesh.load(tmp_path / "mesh.ply", process=False)
    away = np.linalg.norm(surface.vertices - WORLD.origin, axis=1) / WORLD.unit
    assert np.median(away) == pytest.approx(RADIUS, rel=0.08)  # a pixel is 0.05
    equatorial = (
        np.abs((surface.vertices - WORLD.origin)[:, 1]) < 0.7 * RADIUS * WORLD.unit
    )  # from its equator
    assert np.quantile(np.abs(away[equatorial] / RADIUS - 1), 0.9) < 0.1  # a pixel is a tenth of the radius
    centres = surface.triangles_center - WORLD.origin
    outwards = (centres * surface.face_normals).sum(1) > 0
    assert np.average(outwards, weights=surface.area_faces) > 0.97
    table = read_ply(tmp_path / "mesh.ply", faces=True)
    vertices = np.stack([table[axis] for axis in "xyz"], 1)
    colours = np.stack([table[f"radiance_{name}"] for name in ("red", "green", "blue")], 1)
    assert np.abs(surface.visual.vertex_colors[:, :3] - 255 * srgb_encode(colours.clip(0, 1))).max() <= 0.51
    side = (vertices - WORLD.origin)[:, 0] / WORLD.unit
    bright, dim = colours[side > 0.2], colours[side < -0.2]
    assert np.median(bright) == pytest.approx(GREY * exported.exposure_factor, rel=0.05)
    assert np.median(dim) == pytest.approx(
        GREY / 1024 * exported.exposure_factor, rel=0.2
    )  # some shines through


def test_a_scene_without_a_surface_is_refused(sphere: Scene, tmp_path: Path) -> None:
    thin = {**sphere.gaussians.parameters, "opacity_logits": torch.full((1500,), -5.0)}
    with pytest.raises(ReconstructionError, match="so there is no mesh: export points"):
        export(replace(sphere, gaussians=Gaussians(thin)), tmp_path / "mesh.ply", "mesh")
    assert not list(tmp_path.iterdir())
