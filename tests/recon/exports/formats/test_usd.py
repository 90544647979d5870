"""USD files, read back and validated by OpenUSD itself."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdValidation, UsdVol

from imaging.errors import InputError
from imaging.files.exr.reading import read_exr
from recon.exports.formats.usd import COLOUR_SPACE, write_usd
from recon.exports.loss import drawn
from recon.exports.splats import Splats, linear_splats
from recon.exports.target_coordinates import place_of
from recon.result.model import SceneView
from recon.result.scene import Scene, open_scene

FACTOR = 1.75


def written(scene: Scene, path: Path) -> Usd.Stage:
    write_usd(path, scene, linear_splats(scene, FACTOR, with_dome=False), place_of(scene))
    return Usd.Stage.Open(str(path))


def read_back(stage: Usd.Stage, scene: Scene) -> Splats:
    """Read by the schema of OpenUSD, value by value."""
    field = UsdVol.ParticleField3DGaussianSplat(stage.GetPrimAtPath("/World/Splats"))
    quats = [(q.real, *q.imaginary) for q in field.GetOrientationsAttr().Get()]
    degree = field.GetRadianceSphericalHarmonicsDegreeAttr().Get()
    harmonics = np.array(field.GetRadianceSphericalHarmonicsCoefficientsAttr().Get(), np.float64)
    return Splats(
        means=np.array(field.GetPositionsAttr().Get(), np.float64),
        scales=np.array(field.GetScalesAttr().Get(), np.float64),
        quats=np.array(quats, np.float64),
        opacities=np.array(field.GetOpacitiesAttr().Get(), np.float64),
        harmonics=harmonics.reshape(-1, (degree + 1) ** 2, 3),
        linear=True,
        factor=stage.GetRootLayer().customLayerData["rig"]["exposureFactor"],
        world=scene.record.world,
        offset=scene.record.offset,
    )


def off(scene: Scene, splats: Splats, view: SceneView) -> np.ndarray:
    """Relative difference of light where there is any."""
    light, other = scene.render(view.splat_camera), drawn(scene, splats, view.splat_camera)
    return np.abs(other[light > 0] / light[light > 0] - 1)


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
@pytest.mark.parametrize("name", ["made", "made_sky"])
def test_light_read_from_usd_and_drawn_is_that_of_the_scene(
    name: str, suffix: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    scene = open_scene(request.getfixturevalue(name))
    splats = read_back(written(scene, tmp_path / f"scene.{suffix}"), scene)
    for view in scene.views:
        light = scene.render(view.splat_camera)
        assert np.quantile(off(scene, splats, view), 0.99) < 1e-3
        assert np.ptp(np.log2(light[light > 0])) > 8  # else anything would do


def test_colours_by_direction_are_as_near_as_plain_harmonics_are(made_shiny: Path, tmp_path: Path) -> None:
    scene = open_scene(made_shiny)
    splats = read_back(written(scene, tmp_path / "scene.usdc"), scene)
    assert splats.harmonics.shape == (400, 9, 3)
    differences = np.concatenate([off(scene, splats, view) for view in scene.views])
    assert np.median(differences) < 0.03
    splats.harmonics[:, 1:] = 0
    without = np.concatenate([off(scene, splats, view) for view in scene.views])
    assert np.median(differences) < 0.3 * np.median(without)


@pytest.mark.parametrize("name", ["made", "made_sky", "made_shiny"])
def test_every_validator_of_openusd_passes(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    stage = written(open_scene(request.getfixturevalue(name)), tmp_path / "scene.usdc")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in errors] == []


@pytest.mark.parametrize("name", ["made", "made_sky", "made_shiny"])
def test_every_rule_of_nvidia_passes(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """`usd-validation-nvidia`: what Omniverse asks of an asset."""
    nvidia = pytest.importorskip("usd_validation_nvidia", reason="pip install usd-validation-nvidia")
    stage = written(open_scene(request.getfixturevalue(name)), tmp_path / "scene.usdc")
    engine = nvidia.ValidationEngine()
    assert len(engine.rules) > 40
    issues = engine.validate(str(tmp_path / "scene.usdc")).issues()
    assert [(issue.rule.__name__, issue.message) for issue in issues] == []
    stage.GetPrimAtPath("/World/Splats").GetAttribute("extent").Clear()
    assert [issue.rule.__name__ for issue in engine.validate(stage).issues()] == ["ExtentsChecker"]


def test_what_is_said_of_light_and_lengths(made: Path, made_sky: Path, tmp_path: Path) -> None:
    stage = written(open_scene(made_sky), tmp_path / "a.usda")
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    custom = stage.GetRootLayer().customLayerData["rig"]
    assert (custom["lengthUnit"], custom["exposureFactor"]) == ("m", FACTOR)
    assert custom["whiteLuminance"] == pytest.approx(250 / FACTOR)
    assert "EPSG:25832 less (450000, 5410000, 300)" in custom["coordinates"]
    coefficients = stage.GetPrimAtPath("/World/Splats").GetAttribute(
        "radiance:sphericalHarmonicsCoefficients"
    )
    assert coefficients.GetColorSpace() == COLOUR_SPACE == Gf.ColorSpaceNames.LinearRec709
    other = written(open_scene(made), tmp_path / "b.usda")
    assert UsdGeom.GetStageUpAxis(other) == "Y"
    assert other.GetRootLayer().customLayerData["rig"]["lengthUnit"] == "unknown"
    assert "metersPerUnit 1 is a guess" in other.GetRootLayer().documentation


def test_the_way_up_of_the_photographs_becomes_y(scene: Scene, tmp_path: Path) -> None:
    stage = written(scene, tmp_path / "scene.usda")
    turn = UsdGeom.Xformable(stage.GetPrimAtPath("/World")).GetLocalTransformation()
    assert np.allclose(turn.TransformDir(Gf.Vec3d(*scene.up.tolist())), (0, 1, 0), atol=1e-12)
    assert turn.GetDeterminant3() == pytest.approx(1)


def test_cameras_see_what_the_views_saw(scene: Scene, tmp_path: Path) -> None:
    """Points through the frustum of OpenUSD fall on the pixels of the view, its distortion left out."""
    from recon.exports.target_coordinates import pinhole

    stage = written(scene, tmp_path / "scene.usda")
    to_world = UsdGeom.Xformable(stage.GetPrimAtPath("/World")).GetLocalTransformation()
    points = np.random.default_rng(2).normal(scene.record.world.origin, 0.8, (20, 3))
    cameras = {
        prim.GetDisplayName(): UsdGeom.Camera(prim)
        for prim in stage.GetPrimAtPath("/World/Cameras").GetChildren()
    }
    assert sorted(cameras) == ["a-1", "a.1"]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 1)
    for view in scene.views:
        frustum = cameras[view.camera].GetCamera(view.frame).frustum
        project = frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()
        camera = pinhole(view.splat_camera)
        for point in points:
            ndc = project.Transform(to_world.Transform(Gf.Vec3d(*point.tolist())))
            x, y, z = camera.cam_from_world[:3, :3] @ point + camera.cam_from_world[:3, 3]
            expected = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
            pixel = 0.5 * (1 + ndc[0]) * camera.width, 0.5 * (1 - ndc[1]) * camera.height
            assert pixel == pytest.approx(expected, abs=1e-4)


def test_what_does_not_change_is_a_plain_value_in_millimetres(scene: Scene, tmp_path: Path) -> None:
    """OpenUSD has lenses in tenths of a unit, here of a metre; programs show millimetres."""
    stage = written(scene, tmp_path / "scene.usda")
    to_mm = 0.1 * UsdGeom.GetStageMetersPerUnit(stage) * 1000
    for prim in stage.GetPrimAtPath("/World/Cameras").GetChildren():
        moving = [one.GetName() for one in prim.GetAttributes() if one.GetNumTimeSamples()]
        assert moving == ["xformOp:transform"]
        camera, (view, *_) = (
            UsdGeom.Camera(prim),
            [v for v in scene.views if v.camera == prim.GetDisplayName()],
        )
        assert to_mm * camera.GetHorizontalApertureAttr().Get() == pytest.approx(36)
        assert to_mm * camera.GetFocalLengthAttr().Get() == pytest.approx(36 * view.lens.fx / view.lens.width)
        at_rest = camera.GetCamera(Usd.TimeCode.Default())
        for time in (0, 1):
            assert camera.GetCamera(time).focalLength == at_rest.focalLength
            assert camera.GetCamera(time).horizontalApertureOffset == at_rest.horizontalApertureOffset
        assert at_rest.transform == camera.GetCamera(view.frame).transform


def test_lenses_that_change_are_animated(scene: Scene, tmp_path: Path) -> None:
    first, *others = scene.views
    wide = first.model_copy(update={"lens": first.lens.model_copy(update={"fx": 25.0, "fy": 23.5})})
    changed = replace(scene, record=scene.record.model_copy(update={"views": (wide, *others)}))
    stage = written(changed, tmp_path / "scene.usda")
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Cameras/a_1"))
    assert [10 * camera.GetFocalLengthAttr().Get(time) for time in (0, 1)] == pytest.approx(
        [3.6 * fx / 48 for fx in (25, 50)]
    )


def test_the_dome_light_shows_the_map_where_the_scene_has_it(made_sky: Path, tmp_path: Path) -> None:
    """A direction through the light's transform, looked up as in OpenEXR's maps, has the scene's light."""
    scene = open_scene(made_sky)
    far = scene.renderer.environment
    assert far is not None
    stage = written(scene, tmp_path / "scene.usda")
    dome = UsdLux.DomeLight(stage.GetPrimAtPath("/World/Environment"))
    path = Path(dome.GetTextureFileAttr().Get().resolvedPath)
    assert path == tmp_path / "scene.environment.exr"
    picture = read_exr(path).rgb()
    to_light = UsdGeom.Xformable(dome.GetPrim()).GetLocalTransformation().GetInverse()
    rows = len(picture)
    for row, column in ((3, 5), (16, 40), (28, 60)):
        direction = far.directions()[row, column]
        x, y, z = to_light.TransformDir(Gf.Vec3d(*direction.tolist()))
        longitude, latitude = np.arctan2(x, z), np.arcsin(y)
        at = (np.pi / 2 - latitude) / np.pi * rows, (np.pi - longitude) / (2 * np.pi) * 2 * rows
        assert at == pytest.approx((row + 0.5, column + 0.5))
        expected = np.exp(far.ln_light[:, row, column].numpy()) * scene.record.normaliser * FACTOR
        assert np.allclose(picture[row, column], expected, rtol=1e-5)


def test_another_name_is_refused(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"end it in \.usd, \.usdc or \.usda"):
        written(scene, tmp_path / "scene.usdz")
