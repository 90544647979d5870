"""PLY files, read by gsply, and number by number."""

from pathlib import Path

import numpy as np
import trimesh

from imaging.colour.spaces import srgb_encode
from recon.exports.export import export
from recon.exports.splats import linear_splats
from recon.result.scene import open_scene
from recon.scene.ply import plain_harmonics, write_ply
from tests.foreign_gsply import gsply
from tests.recon.ply_files import read_ply as read_table


def test_gsply_reads_linear_light(made_sky: Path, tmp_path: Path) -> None:
    scene = open_scene(made_sky)
    exported = export(scene, tmp_path / "scene.ply", linear=True, exposure=3.0)
    splats = gsply.plyread(str(tmp_path / "scene.ply"))
    expected = linear_splats(scene, 8.0, with_dome=True)
    assert exported.gaussians == len(splats.means) == len(expected) > len(scene.gaussians)
    assert np.allclose(splats.means, expected.means, atol=1e-4)
    assert np.allclose(splats.sh0, expected.harmonics[:, 0], rtol=1e-5, atol=1e-5)
    header = (tmp_path / "scene.ply").read_bytes().partition(b"end_header")[0].decode("ascii")
    assert "comment linear Rec.709 radiance x 8 (relative to camera signal" in header
    assert "comment whiteLuminance 31.25: cd/m2" in header
    assert "comment coordinates: EPSG:25832 less" in header


def test_at_the_scenes_own_exposure_it_is_its_own_splats_ply(made: Path, tmp_path: Path) -> None:
    scene = open_scene(made)
    folder = tmp_path / "scene"
    folder.mkdir()
    for path in made.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    harmonics = plain_harmonics(scene.gaussians, scene.renderer.appearance, 0)
    write_ply(folder / "splats.ply", scene.gaussians, harmonics * 0.1, ["own"], scene.record.world)
    export(folder, tmp_path / "out.ply")
    table, other = read_table(folder / "splats.ply"), read_table(tmp_path / "out.ply")
    assert table.keys() == other.keys() - {"nx", "ny", "nz"}
    for name, values in table.items():
        if not name.startswith("rot"):
            assert np.allclose(values, other[name], rtol=1e-4, atol=1e-5), name


def test_another_exposure_is_fitted_anew(made_sky: Path, tmp_path: Path) -> None:
    """Expect the same light, brighter by as much."""
    scene = open_scene(made_sky)
    exported = [export(scene, tmp_path / f"{stops}.ply", exposure=stops) for stops in (0.0, 1.0)]
    colours = [0.5 + 0.28209479 * gsply.plyread(str(one.files[0])).sh0 for one in exported]
    assert np.median(colours[1] - colours[0]) > 0.02
    for one in exported:
        assert one.loss is not None
        assert one.loss.pixel_median < 1.2
        assert 0 < one.loss.clipped < 0.9
    assert exported[1].loss.clipped > exported[0].loss.clipped


def test_points_are_the_solid_ones_in_linear_light(made_sky: Path, tmp_path: Path) -> None:
    scene = open_scene(made_sky)
    exported = export(scene, tmp_path / "points.ply", "points")
    table = read_table(tmp_path / "points.ply")
    solid = scene.gaussians.opacities().numpy() >= 0.5
    means = scene.record.world.to_world(scene.gaussians.parameters["means"].numpy())[solid]
    assert np.allclose(np.stack([table[axis] for axis in "xyz"], 1), means, atol=1e-5)
    light = linear_splats(scene, scene.exposure, with_dome=False).light[solid] * scene.exposure
    radiance = np.stack([table[f"radiance_{name}"] for name in ("red", "green", "blue")], 1)
    assert np.allclose(radiance, light, rtol=1e-5)
    assert radiance.max() > 2
    cloud = trimesh.load(tmp_path / "points.ply")
    assert np.abs(cloud.colors[:, :3] - 255 * srgb_encode(light.clip(0, 1))).max() <= 0.51
    head = (tmp_path / "points.ply").read_bytes().partition(b"end_header")[0].decode()
    assert "red, green, blue: display values, sRGB of the light, clipped at 1" in head
    assert "radiance_blue: linear Rec.709 radiance" in head
    assert any("less than half opaque" in note for note in exported.notes)
    assert any("far away" in note for note in exported.notes)
