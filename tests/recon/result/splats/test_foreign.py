"""Splats of others: written by gsply, or by `rig` for others, and opened as scenes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from pxr import Gf, Usd, UsdGeom, UsdVol

from imaging.errors import InputError, ReconstructionError
from imaging.session.paths import SPLAT_FILES
from recon.exports.export import export
from recon.exports.target_coordinates import pinhole
from recon.measure.evaluate import evaluate
from recon.rendering.render import render
from recon.result.scene import Scene, open_scene
from recon.scene.appearance import PlainHarmonics
from recon.scene.gaussians import Gaussians, Renderer
from recon.scene.ply import properties
from recon.splat import Limits
from tests.foreign_gsply import gsply
from tests.recon.exports.made_scene import write_made

COUNT = 200


def cloud(degree: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Around (100, 20, -5), a few units wide, float32 as gsply takes them."""
    rng = np.random.default_rng(seed)
    quats = rng.normal(0, 1, (COUNT, 4))
    values = {
        "means": rng.normal([100, 20, -5], 2, (COUNT, 3)),
        "scales": np.log(0.3) + rng.normal(0, 0.3, (COUNT, 3)),
        "quats": quats / np.linalg.norm(quats, axis=1, keepdims=True),
        "opacities": rng.normal(1, 2, COUNT),
        "sh0": rng.normal(0, 0.8, (COUNT, 3)),
        "shN": rng.normal(0, 0.2, (COUNT, (degree + 1) ** 2 - 1, 3)),
    }
    return {name: np.ascontiguousarray(value, np.float32) for name, value in values.items()}


def drawn(values: dict[str, np.ndarray], scene: Scene) -> np.ndarray:
    """Codes of the first view, drawn in the coordinates of the file."""
    rest = np.zeros((COUNT, 8, 3), np.float32)
    rest[:, : min(values["shN"].shape[1], 8)] = values["shN"][:, :8]
    names = {"means": "means", "log_scales": "scales", "quats": "quats", "opacity_logits": "opacities"}
    tensors = {name: torch.from_numpy(values[fields]) for name, fields in names.items()}
    tensors |= {"sh_dc": torch.from_numpy(values["sh0"][:, None]), "sh_rest": torch.from_numpy(rest)}
    image = Renderer(PlainHarmonics(), Limits.gsplat())(
        Gaussians(tensors), scene.views[0].splat_camera, degree=scene.record.degree
    ).image
    return image.numpy()


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_a_ply_of_gsply_is_drawn_as_it_would_be_where_it_lies(degree: int, tmp_path: Path) -> None:
    values = cloud(degree)
    path = tmp_path / "theirs.ply"
    gsply.plywrite(
        str(path), *(values[name] for name in ("means", "scales", "quats", "opacities", "sh0", "shN"))
    )
    scene = open_scene(path)
    codes = drawn(values, scene)
    assert (
        np.abs(codes - scene.drawn(scene.record.world.camera(scene.views[0].splat_camera)).numpy()).max()
        < 2e-3
    )
    assert (codes.max(2) > 0.3).mean() > 0.05  # the orbit looks at it
    shown = np.asarray(scene.at(), np.float64) / 255
    assert np.abs(shown - codes.clip(0, 1)).max() < 0.01


def test_an_orbit_sees_all_of_it_from_all_around(tmp_path: Path) -> None:
    values = cloud(0)
    gsply.write_spz(str(tmp_path / "a.spz"), gsply.GSData(**{**values, "shN": None}, masks=None, _base=None))
    scene = open_scene(tmp_path / "a.spz")
    means = scene.record.world.to_world(scene.gaussians.parameters["means"].numpy())
    sides = []
    for view in scene.views:
        camera = view.splat_camera
        local = means @ camera.cam_from_world[:3, :3].T + camera.cam_from_world[:3, 3]
        across = camera.fx * local[:, 0] / local[:, 2] + camera.cx
        down = camera.fy * local[:, 1] / local[:, 2] + camera.cy
        inside = (
            (across > 0) & (across < camera.width) & (down > 0) & (down < camera.height) & (local[:, 2] > 0)
        )
        assert (inside & (local[:, 2] > 0)).mean() > 0.8
        sides.append(camera.cam_from_world[2, :3])
    assert np.linalg.norm(np.mean(sides, axis=0)[[0, 2]]) < 1e-6
    assert np.allclose(scene.up, [0, -1, 0], atol=1e-6)


@pytest.mark.parametrize("name", ["scene.usdc", "scene.ply"])
def test_light_goes_out_and_comes_back(name: str, tmp_path: Path) -> None:
    scene = open_scene(write_made(tmp_path / "made"))
    export(scene, tmp_path / name, linear=True)
    back = open_scene(tmp_path / name)
    for view in scene.views:
        camera = pinhole(view.splat_camera)
        light, returned = scene.render(camera) * scene.exposure, back.render(camera)
        bright = light > 1e-3
        off = np.abs(returned[bright] / light[bright] - 1)
        assert np.median(off) < 0.01
        assert np.quantile(off, 0.99) < 0.08  # the file does not say at which distances it was trained
    if name.endswith("usdc"):
        assert sorted((view.camera, view.frame) for view in back.views) == sorted(
            (view.camera, view.frame) for view in scene.views
        )
        same = scene.render(pinhole(scene.views[0].splat_camera)) * scene.exposure
        assert np.abs(back.render(back.view(scene.views[0].name)) - same).max() < 0.08 * same.max()


def test_a_usd_of_half_floats_that_stands_elsewhere(tmp_path: Path) -> None:
    """Half precision, turned, enlarged and moved by its prim; colours without a space are display values."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "half.usda"))
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/group/splats")
    field.CreatePositionshAttr([Gf.Vec3h(0, 0, 0), Gf.Vec3h(1, 0, 0)])
    field.CreateScaleshAttr([Gf.Vec3h(0.1, 0.1, 0.1)] * 2)
    field.CreateOrientationshAttr([Gf.Quath(1, 0, 0, 0)] * 2)
    field.CreateOpacitieshAttr([1.0, 1.0])
    field.CreateRadianceSphericalHarmonicsDegreeAttr(0)
    field.CreateRadianceSphericalHarmonicsCoefficientshAttr([Gf.Vec3h(1, 1, 1), Gf.Vec3h(-1, 1, 0)])
    transform = UsdGeom.Xformable(stage.GetPrimAtPath("/group/splats")).AddTransformOp()
    matrix = Gf.Matrix4d().SetScale(2) * Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(0, 0, 1), 90))
    transform.Set(matrix * Gf.Matrix4d().SetTranslate(Gf.Vec3d(5, 0, 0)))
    camera = UsdGeom.Camera.Define(stage, "/eye")
    camera.AddTranslateOp().Set(Gf.Vec3d(5, 1, 10))
    stage.Save()
    scene = open_scene(tmp_path / "half.usda")
    assert scene.record.display is not None
    (view,) = scene.views
    lit = np.argwhere(scene.drawn(scene.record.world.camera(view.splat_camera)).numpy().max(2) > 0.4)
    # The two lie at (5, 0, 0) and, since x is turned to y, at (5, 2, 0): about the middle of the picture.
    assert np.abs(lit[:, 1].mean() - view.lens.cx) < 3
    assert np.abs(lit[:, 0].mean() - view.lens.cy) < 3
    assert np.ptp(lit[:, 0]) == pytest.approx(2 / 10 * view.lens.fy, rel=0.4)


@pytest.mark.parametrize(
    ("given", "names"),
    [
        (("_cam", "..a..b"), ("cam", "a.b")),
        (("Камера", ""), ("camera", "two")),
        (("cam", "cam"), ("cam", "cam-2")),
        (("a 1", "a_1"), ("a_1", "a_1-2")),
    ],
)
def test_cameras_of_a_usd_get_names_that_are_plain_and_their_own(
    given: tuple[str, str], names: tuple[str, str], tmp_path: Path
) -> None:
    export(open_scene(write_made(tmp_path / "made", count=20)), tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    stage.RemovePrim("/World/Cameras")
    for prim, name in zip(("one", "two"), given, strict=True):
        camera = UsdGeom.Camera.Define(stage, f"/{prim}")
        camera.GetPrim().SetDisplayName(name)
        for frame in (0, 1):
            camera.GetPrim().GetAttribute("focalLength").Set(50.0, frame)
        moved = camera.AddTranslateOp()
        moved.Set(Gf.Vec3d(0, 0, 9), 0)
        moved.Set(Gf.Vec3d(0, 1, 9), 1)
    stage.Save()
    views = open_scene(tmp_path / "a.usda").views
    assert [(view.camera, view.frame) for view in views] == [
        (name, frame) for name in names for frame in (0, 1)
    ]


def test_a_file_stands_where_a_scene_does(tmp_path: Path) -> None:
    write_made(tmp_path / "made")
    export(tmp_path / "made", tmp_path / "a.ply")
    (exr, png, *_) = render(tmp_path / "a.ply", tmp_path / "out", views=["0000/orbit"])
    assert exr.name == "0000_orbit.exr"
    with Image.open(png) as picture:
        assert picture.size == (640, 480)
    exported = export(tmp_path / "a.ply", tmp_path / "again.spz")
    assert exported.loss is not None
    assert exported.loss.pixel_p99 < 1
    with pytest.raises(ReconstructionError, match="a file of splats, without the photographs"):
        evaluate(tmp_path / "a.ply")


@pytest.mark.parametrize("suffix", SPLAT_FILES)
@pytest.mark.parametrize(
    "content", [b"", b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n", b"\x00" * 99]
)
def test_what_is_no_splat_file_is_refused(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"bad{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"^/.*\.$"):
        open_scene(path)


@pytest.mark.parametrize(("count", "says"), [(0, "holds no Gaussian"), (10**9, "ends"), (10**25, "ends")])
def test_a_ply_that_claims_none_or_more_than_it_holds_is_refused(
    tmp_path: Path, count: int, says: str
) -> None:
    header = "".join(f"property float {name}\n" for name in properties(0))
    path = tmp_path / "a.ply"
    path.write_text(f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{header}end_header\n")
    with pytest.raises(InputError, match=says):
        open_scene(path)


def test_gaussians_that_are_no_numbers_are_left_out(tmp_path: Path) -> None:
    values = cloud(0)
    values["means"][3] = np.nan
    values["sh0"][4] = np.inf
    values["opacities"][5] = np.inf
    path = tmp_path / "a.ply"
    gsply.plywrite(str(path), *(values[name] for name in ("means", "scales", "quats", "opacities", "sh0")))
    scene = open_scene(path)
    assert len(scene.gaussians) == COUNT - 2
    assert np.isfinite(scene.render(scene.views[0])).all()
    values["means"][:] = np.nan
    gsply.plywrite(str(path), *(values[name] for name in ("means", "scales", "quats", "opacities", "sh0")))
    with pytest.raises(InputError, match="no Gaussian that can be drawn"):
        open_scene(path)


def test_an_open_scene_stays_the_one_it_is(tmp_path: Path) -> None:
    scene = open_scene(write_made(tmp_path))
    changed = replace(scene, record=scene.record)
    assert open_scene(changed) is changed


@pytest.mark.parametrize(
    ("times", "frames"), [((1, 2, 3), [1, 2, 3]), ((-1, 0, 1), [0, 1, 2]), ((0.2, 0.4, 0.6), [0, 1, 2])]
)
def test_a_camera_of_a_usd_that_its_parent_moves(
    times: tuple[float, ...], frames: list[int], tmp_path: Path
) -> None:
    """As Blender writes cameras; times that round to one frame, or lie before 0, are numbered in order."""
    export(open_scene(write_made(tmp_path / "made", count=20)), tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    stage.RemovePrim("/World/Cameras")
    moved = UsdGeom.Xform.Define(stage, "/rails").AddTranslateOp()
    UsdGeom.Camera.Define(stage, "/rails/camera")
    for number, time in enumerate(times):
        moved.Set(Gf.Vec3d(0, number, 9), time)
    stage.Save()
    views = open_scene(tmp_path / "a.usda").views
    assert [view.frame for view in views] == frames
    centres = np.array([np.linalg.inv(view.cam_from_world.matrix())[:3, 3] for view in views])
    assert np.linalg.norm(np.diff(centres, axis=0), axis=1) == pytest.approx(1)
