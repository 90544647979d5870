"""Cameras go out in every format that `rig export` writes them in, and come back by `rig render --path`."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from imaging.errors import InputError, ReconstructionError
from imaging.optics.pose import OPENGL_FROM_OPENCV
from recon.exports.export import export
from recon.exports.target_coordinates import pinhole
from recon.rendering.render import camera_path, render
from recon.result.model import SceneView
from recon.result.scene import Scene, open_scene
from recon.splat import SplatCamera

OFFSET = (4.0e5, -3.0e3, 12.0)
Y_FROM_Z = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Coordinates with y up from those with z up."""


@pytest.fixture(params=["as the photographs were held", "survey", "offset"])
def placed(request: pytest.FixtureRequest, made: Path, made_sky: Path) -> Scene:
    scene = open_scene(made_sky if request.param == "survey" else made)
    if request.param == "offset":
        scene = replace(scene, record=scene.record.model_copy(update={"offset": OFFSET}))
    return scene


def check(camera_of_file: SplatCamera, view: SceneView, *, lens: bool = True) -> None:
    expected = view.splat_camera
    np.testing.assert_allclose(
        camera_of_file.cam_from_world[:3, :3], expected.cam_from_world[:3, :3], atol=1e-9
    )
    centres = [
        -camera.cam_from_world[:3, :3].T @ camera.cam_from_world[:3, 3]
        for camera in (camera_of_file, expected)
    ]
    np.testing.assert_allclose(*centres, rtol=0, atol=1e-6)
    if lens:
        numbers = ("fx", "fy", "cx", "cy", "width", "height")
        for name in numbers:
            assert getattr(camera_of_file, name) == pytest.approx(getattr(expected, name), rel=1e-6)


@pytest.mark.parametrize("suffix", ["usd", "usda", "usdc"])
@pytest.mark.parametrize("camera", ["a-1", "a.1"])
def test_usd(placed: Scene, suffix: str, camera: str, tmp_path: Path) -> None:
    path = tmp_path / f"scene.{suffix}"
    export(placed, path)
    moving = camera_path(placed, path, camera=camera)
    assert moving.numbers == (0, 1)
    for number, one in zip(moving.numbers, moving.cameras, strict=True):
        check(one, placed.view(f"{number:04d}/{camera}"))


@pytest.mark.parametrize("path", ["colmap", "transforms.json"])
def test_colmap_and_nerfstudio(placed: Scene, path: str, tmp_path: Path) -> None:
    export(placed, tmp_path, "cameras")
    cameras = camera_path(placed, tmp_path / path).cameras
    views = sorted(placed.views, key=lambda view: view.id.image_name) if path == "colmap" else placed.views
    for one, view in zip(cameras, views, strict=True):
        check(one, view)
        assert (one.k1, one.k2, one.p1, one.p2) == view.lens.terms[4:]


def in_stage(scene: Scene, view: SceneView, path: Path) -> np.ndarray:
    """The pose of a view in the stage of `rig export`, by OpenUSD: camera to stage, z back."""
    stage = Usd.Stage.Open(str(path))
    world = np.array(UsdGeom.Xformable(stage.GetPrimAtPath("/World")).GetLocalTransformation()).T
    pose = np.linalg.inv(view.cam_from_world.matrix()) @ OPENGL_FROM_OPENCV
    pose[:3, 3] -= scene.record.offset
    return np.asarray(world @ pose)


@pytest.mark.parametrize("z_up", [True, False])
@pytest.mark.parametrize("metres", [1.0, 0.01])
def test_a_camera_made_in_the_stage_by_a_program_of_other_axes_and_units(
    placed: Scene, z_up: bool, metres: float, tmp_path: Path
) -> None:
    """Write as Blender does: everything below a root, turned and scaled; or the new camera alone."""
    view, path = placed.views[3], tmp_path / "scene.usdc"
    export(placed, path)
    was_z_up = UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(path))) == "Z"
    moved = np.diag([1 / metres] * 3 + [1.0])
    if was_z_up != z_up:
        moved = moved @ (Y_FROM_Z if was_z_up else Y_FROM_Z.T)
    for whole in (True, False):
        again = tmp_path / f"again-{whole}.usda"
        stage = Usd.Stage.CreateNew(str(again))
        UsdGeom.SetStageUpAxis(stage, "Z" if z_up else "Y")
        UsdGeom.SetStageMetersPerUnit(stage, metres)
        root = UsdGeom.Xform.Define(stage, "/root")
        if whole:
            root.AddTransformOp().Set(Gf.Matrix4d(*moved.T.ravel().tolist()))
            stage.DefinePrim("/root/World").GetReferences().AddReference(str(path), "/World")
        camera = UsdGeom.Camera.Define(stage, "/root/Shot/ShotData")
        camera.CreateFocalLengthAttr(50.0)
        camera.CreateHorizontalApertureAttr(48.0)
        camera.CreateVerticalApertureAttr(36.0)
        pose = in_stage(placed, view, path) if whole else moved @ in_stage(placed, view, path)
        camera.AddTransformOp().Set(Gf.Matrix4d(*pose.T.ravel().tolist()))
        stage.Save()
        moving = camera_path(placed, again, within=None if whole else path)
        check(moving.cameras[0], view, lens=False)
        assert "/root/Shot/ShotData" in moving.note
        if whole:
            (tmp_path / "own").mkdir()
            named = camera_path(placed, again, camera="a.1")
            check(named.cameras[1], placed.view("0001/a.1"))


def table(path: Path, pose: np.ndarray, *comments: str) -> Path:
    with path.open("w", newline="") as file:
        file.writelines(f"{line}\n" for line in comments)
        cells = {f"m{row}{column}": pose[row, column] for row in range(3) for column in range(4)}
        writer = csv.DictWriter(file, cells)
        writer.writeheader()
        writer.writerow(cells)
    return path


@pytest.mark.parametrize("within", ["scene.usdc", "scene.glb", "scene.ply"])
@pytest.mark.parametrize("metres", [1.0, 0.01])
def test_a_table_says_its_axes_and_the_command_its_file(
    placed: Scene, within: str, metres: float, tmp_path: Path
) -> None:
    view, path = placed.views[2], tmp_path / within
    export(placed, path)
    if within == "scene.ply":
        pose = np.linalg.inv(view.cam_from_world.matrix()) @ OPENGL_FROM_OPENCV
        pose[:3, 3] -= placed.record.offset
        check(
            camera_path(placed, table(tmp_path / "shot.csv", pose), within=path).cameras[0], view, lens=False
        )
        return
    export(placed, tmp_path / "a.usdc")
    pose = in_stage(placed, view, tmp_path / "a.usdc")
    z_up = UsdGeom.GetStageUpAxis(Usd.Stage.Open(str(tmp_path / "a.usdc"))) == "Z"
    if within == "scene.glb" and z_up:
        pose, z_up = Y_FROM_Z @ pose, False
    check(camera_path(placed, table(tmp_path / "same.csv", pose), within=path).cameras[0], view, lens=False)
    turned = Y_FROM_Z @ pose if z_up else Y_FROM_Z.T @ pose
    turned[:3, 3] /= metres
    shot = table(tmp_path / "shot.csv", turned, f"# up: {'y' if z_up else 'z'}", f"# metersPerUnit: {metres}")
    check(camera_path(placed, shot, within=path).cameras[0], view, lens=False)
    scaled = pose.copy()
    scaled[:3, 3] /= metres
    alone = (table(tmp_path / "unit.csv", scaled, f"# metersPerUnit: {metres}"),)
    if metres == 1:
        alone = (*alone, table(tmp_path / "up.csv", turned, f"# up: {'y' if z_up else 'z'}"))
    for shot in alone:
        check(camera_path(placed, shot, within=path).cameras[0], view, lens=False)


def test_a_scene_of_a_file_is_in_the_coordinates_of_that(placed: Scene, tmp_path: Path) -> None:
    export(placed, tmp_path / "scene.usdc")
    opened = open_scene(tmp_path / "scene.usdc")
    cameras = camera_path(opened, tmp_path / "scene.usdc", camera="a.1").cameras
    for number, one in enumerate(cameras):
        expected = opened.view(f"{number:04d}/a.1").splat_camera
        np.testing.assert_allclose(one.cam_from_world, expected.cam_from_world, atol=1e-6)


def test_renders_of_the_exported_stage_are_the_views(made: Path, tmp_path: Path) -> None:
    scene = open_scene(made)
    export(scene, tmp_path / "scene.usdc")
    from imaging.files.exr.reading import read_exr

    said: list[str] = []
    path = camera_path(scene, tmp_path / "scene.usdc", camera="a.1")
    files = render(scene, tmp_path / "out", path=path, exposure=0.0, on_message=said.append)
    for number in (0, 1):
        light = read_exr(files[number]).rgb()
        expected = scene.render(pinhole(scene.view(f"{number:04d}/a.1").splat_camera))
        np.testing.assert_allclose(light, expected, rtol=1e-3, atol=1e-5 * expected.max())
    assert said == []


AWAY: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "turned away": lambda pose: pose @ np.diag([-1.0, 1, -1, 1]),
    "far away": lambda pose: pose + np.array([[0, 0, 0, 1e4], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]),
}


@pytest.mark.parametrize("name", AWAY)
def test_a_render_that_sees_nothing_says_so(made: Path, name: str, tmp_path: Path) -> None:
    scene = open_scene(made)
    pose = np.linalg.inv(scene.views[0].cam_from_world.matrix()) @ OPENGL_FROM_OPENCV
    with pytest.raises(ReconstructionError, match=r"No frame sees anything of .* --path-in"):
        render(scene, tmp_path / "out", path=table(tmp_path / "shot.csv", AWAY[name](pose)))
    both = tmp_path / "both.csv"
    both.write_text(
        (tmp_path / "shot.csv").read_text()
        + table(tmp_path / "b.csv", pose).read_text().splitlines()[1]
        + "\n"
    )
    said: list[str] = []
    assert len(render(scene, tmp_path / "out", path=both, on_message=said.append)) == 4
    coordinates, empty = said
    assert "taken for those of the calibration" in coordinates
    assert empty == "1 of 2 frames do not see the scene, the first is both 1001"


def test_what_does_not_tell_is_refused(scene: Scene, tmp_path: Path) -> None:
    shot = table(tmp_path / "shot.csv", np.eye(4))
    (tmp_path / "a.glb").write_bytes(b"glTF")
    (tmp_path / "a.txt").touch()
    Usd.Stage.CreateNew(str(tmp_path / "a.usda")).Save()
    for name, words in (
        ("none.usda", "does not exist"),
        ("a.glb", "does not state where"),
        ("a.txt", "does not state where"),
        ("a.usda", "does not state where"),
    ):
        with pytest.raises(InputError, match=words):
            camera_path(scene, shot, within=tmp_path / name)
    with pytest.raises(InputError, match="has no cameras by name"):
        camera_path(scene, shot, camera="a")
    with pytest.raises(InputError, match="is not a file of cameras"):
        camera_path(scene, "orbit", within=shot)
    export(scene, tmp_path / "scene.ply")
    for line in ("# up: z", "# metersPerUnit: 0.01"):
        with pytest.raises(InputError, match=r"bad.csv says .*scene.ply names neither: take the lines"):
            camera_path(scene, table(tmp_path / "bad.csv", np.eye(4), line), within=tmp_path / "scene.ply")
    for line, words in (("# up: x", "write y or z"), ("# metersPerUnit: 0", "a number above 0")):
        with pytest.raises(InputError, match=words):
            camera_path(scene, table(tmp_path / "bad.csv", np.eye(4), line))
    export(scene, tmp_path / "scene.usda")
    with pytest.raises(InputError, match="has no camera 'b'"):
        camera_path(scene, tmp_path / "scene.usda", camera="b")
