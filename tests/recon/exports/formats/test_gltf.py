"""glTF files, taken apart by pygltflib, and beside those that PlayCanvas's splat-transform writes."""

from pathlib import Path

import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation

from imaging.progress import unreported
from recon.exports.export import export
from recon.exports.formats.gltf import EXTENSION
from recon.exports.splats import Splats, display_splats, linear_splats
from recon.exports.target_coordinates import place_of
from recon.result.scene import Scene, open_scene
from recon.scene.ply import write_ply
from tests.gltf_validator import issues_of, needs_gltf_validator
from tests.splat_transform import needs_splat_transform, splat_transform


def accessor(file: pygltflib.GLTF2, number: int) -> np.ndarray:
    header = file.accessors[number]
    view = file.bufferViews[header.bufferView]
    kind = {pygltflib.FLOAT: "<f4", pygltflib.UNSIGNED_BYTE: "u1"}[header.componentType]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[header.type]
    data = file.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    values = np.frombuffer(data, kind).reshape(header.count, width)
    return values / 255 if header.normalized else values


def same(path: Path, splats: Splats) -> pygltflib.GLTF2:
    file = pygltflib.GLTF2().load(str(path))
    (primitive,) = file.meshes[0].primitives
    names = {name: number for name, number in vars(primitive.attributes).items() if number is not None}
    values = {name: accessor(file, number) for name, number in names.items()}
    assert np.allclose(values["POSITION"], splats.means, atol=1e-5)
    assert np.allclose(values[f"{EXTENSION}:SCALE"], splats.scales, rtol=1e-5)
    assert np.allclose(values[f"{EXTENSION}:ROTATION"][:, [3, 0, 1, 2]], splats.quats, atol=1e-6)
    assert np.allclose(values[f"{EXTENSION}:OPACITY"][:, 0], splats.opacities, atol=1e-6)
    place = 0
    for degree in range(splats.degree + 1):
        for number in range(2 * degree + 1):
            harmonics = values[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{number}"]
            assert np.allclose(harmonics, splats.harmonics[:, place], rtol=1e-5, atol=1e-5)
            place += 1
    assert place == splats.harmonics.shape[1]
    assert np.abs(values["COLOR_0"][:, :3] - (splats.light * splats.factor).clip(0, 1)).max() < 0.0021
    assert primitive.mode == 0
    assert file.extensionsUsed == [EXTENSION]
    low, high = file.accessors[names["POSITION"]].min, file.accessors[names["POSITION"]].max
    assert np.allclose([low, high], [splats.means.min(0), splats.means.max(0)], atol=1e-5)
    return file


@pytest.mark.parametrize("name", ["made_shiny", "made_sky"])
def test_display_values_are_the_default(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    scene = open_scene(request.getfixturevalue(name))
    exported = export(scene, tmp_path / "scene.glb")
    assert not exported.linear
    file = same(tmp_path / "scene.glb", display_splats(scene, None, unreported))
    assert file.meshes[0].primitives[0].extensions[EXTENSION]["colorSpace"] == "srgb_rec709_display"
    assert exported.gaussians == file.accessors[0].count


def test_linear_light_is_whole(scene: Scene, tmp_path: Path) -> None:
    exported = export(scene, tmp_path / "scene.glb", linear=True)
    file = same(tmp_path / "scene.glb", linear_splats(scene, scene.exposure, with_dome=True))
    assert file.meshes[0].primitives[0].extensions[EXTENSION]["colorSpace"] == "lin_rec709_display"
    assert file.meshes[0].extras["rig:exposureFactor"] == scene.exposure
    assert exported.loss is not None
    assert exported.loss.pixel_p99 < 1e-3


def test_y_is_up(scene: Scene, made_sky: Path, tmp_path: Path) -> None:
    for opened, up in ((scene, scene.up), (open_scene(made_sky), np.array([0.0, 0.0, 1.0]))):
        assert place_of(opened).z_up == (up[2] == 1)
        export(opened, tmp_path / "scene.glb")
        file = pygltflib.GLTF2().load(str(tmp_path / "scene.glb"))
        matrix = np.array(file.nodes[0].matrix).reshape(4, 4).T
        assert np.allclose(matrix[:3, :3] @ up, [0, 1, 0], atol=1e-9)
        assert np.linalg.det(matrix) == pytest.approx(1)


@needs_splat_transform
def test_playcanvas_writes_the_same(made_shiny: Path, tmp_path: Path) -> None:
    """It reads no glTF, but writes it: attributes of the same names, types and values, and the same facts.

    What it was given it turns by half about z; ours stands as it is, and the node turns it.
    """
    scene = open_scene(made_shiny)
    shown = display_splats(scene, None, unreported)
    write_ply(tmp_path / "a.ply", shown.gaussians(), shown.harmonics, [], shown.world, shown.offset)
    splat_transform(tmp_path / "a.ply", tmp_path / "theirs.glb")
    export(scene, tmp_path / "ours.glb")
    ours, theirs = (pygltflib.GLTF2().load(str(tmp_path / name)) for name in ("ours.glb", "theirs.glb"))
    ours_primitive, other = (file.meshes[0].primitives[0] for file in (ours, theirs))
    assert ours_primitive.extensions == other.extensions
    names = {name: number for name, number in vars(ours_primitive.attributes).items() if number is not None}
    assert names == {name: number for name, number in vars(other.attributes).items() if number is not None}
    half = Rotation.from_euler("z", 180, degrees=True)
    negated = {"1_COEF_0", "1_COEF_2", "2_COEF_1", "2_COEF_3"}  # of odd order
    for name, number in names.items():
        one, two = ours.accessors[number], theirs.accessors[number]
        assert (one.componentType, one.type, one.normalized) == (two.componentType, two.type, two.normalized)
        expected, written = accessor(ours, number), accessor(theirs, number)
        if name == "COLOR_0":
            continue  # they write codes of sRGB there, which glTF has linear
        if name == "POSITION":
            expected = half.apply(expected)
        elif name.endswith("ROTATION"):
            expected = (half * Rotation.from_quat(expected)).as_quat(canonical=True)
            written = Rotation.from_quat(written).as_quat(canonical=True)
        elif name.rpartition("DEGREE_")[2] in negated:
            expected = -expected
        assert np.allclose(written, expected, atol=1e-5), name


@needs_gltf_validator
@pytest.mark.parametrize("name", ["made_shiny", "made_sky"])
def test_the_validator_misses_nothing_but_the_attributes_of_the_extension(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """It does not know `KHR_gaussian_splatting`, and calls the names of its attributes invalid."""
    scene = open_scene(request.getfixturevalue(name))
    for linear in (False, True):
        export(scene, tmp_path / "scene.glb", linear=linear)
        faults = [issue for issue in issues_of(tmp_path / "scene.glb") if issue["severity"] < 2]
        assert {issue["code"] for issue in faults} == {"MESH_PRIMITIVE_INVALID_ATTRIBUTE"}
        assert all(f"/{EXTENSION}:" in issue["pointer"] for issue in faults)
