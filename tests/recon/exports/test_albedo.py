"""Albedo in files, read by other programs."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Usd, UsdGeom, UsdValidation

from imaging.errors import InputError
from recon.albedo.estimate import Albedo
from recon.exports.export import export
from recon.result.scene import Scene, open_scene
from tests.foreign_gsply import gsply

FACTOR = 8.0


@pytest.fixture
def values(monkeypatch: pytest.MonkeyPatch) -> Albedo:
    """Albedo of 400 Gaussians, of which 300 are known."""
    rng = np.random.default_rng(5)
    made = Albedo(rng.random((400, 3)), 5 * rng.random((400, 3)), 0.1 * rng.random(400))
    for part in (made.albedo, made.irradiance, made.sigma):
        part[300:] = np.nan
    monkeypatch.setattr("recon.exports.export.albedo_of", lambda scene, progress: made)
    return made


def ply_vertices(path: Path) -> np.ndarray:
    """The table of a PLY as trimesh reads it."""
    table: np.ndarray = trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]
    return table


def test_ply_has_it_as_properties(made_sky: Path, values: Albedo, tmp_path: Path) -> None:
    """Behind the Gaussians are those of the sky, which reflect nothing."""
    path = tmp_path / "scene.ply"
    exported = export(open_scene(made_sky), path, linear=True, exposure=3.0, albedo=True)
    table = ply_vertices(path)
    assert len(table) == exported.gaussians > 400
    for number, channel in enumerate("rgb"):
        np.testing.assert_allclose(
            table[f"albedo_{channel}"][:400].ravel(), values.albedo[:, number], rtol=1e-6
        )
        expected = FACTOR * values.irradiance[:, number]
        np.testing.assert_allclose(table[f"irradiance_{channel}"][:400].ravel(), expected, rtol=1e-6)
    np.testing.assert_allclose(table["albedo_sigma"][:400].ravel(), values.sigma, rtol=1e-6)
    assert np.isnan(table["albedo_sigma"][400:]).all()
    header = path.read_bytes().partition(b"end_header")[0].decode("ascii")
    assert "comment nan: not known" in header
    assert exported.data()["albedo_known"] == 0.75


def test_readers_of_splats_read_the_rest_as_before(made: Path, values: Albedo, tmp_path: Path) -> None:
    scene = open_scene(made)
    export(scene, tmp_path / "with.ply", linear=True, albedo=True)
    export(scene, tmp_path / "without.ply", linear=True)
    one, two = (gsply.plyread(str(tmp_path / f"{name}.ply")) for name in ("with", "without"))
    for name in ("means", "scales", "quats", "opacities", "sh0"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    np.testing.assert_array_equal(
        open_scene(tmp_path / "with.ply").gaussians.parameters["means"],
        open_scene(tmp_path / "without.ply").gaussians.parameters["means"],
    )
    assert not any(name.startswith("albedo") for name in ply_vertices(tmp_path / "without.ply").dtype.names)


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
def test_usd_has_it_as_primvars(made: Path, values: Albedo, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scene.{suffix}"
    export(open_scene(made), path, exposure=3.0, albedo=True)
    stage = Usd.Stage.Open(str(path))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Splats"))
    for name, expected in (("albedo", values.albedo), ("irradiance", FACTOR * values.irradiance)):
        primvar = primvars.GetPrimvar(name)
        assert primvar.GetInterpolation() == UsdGeom.Tokens.vertex
        np.testing.assert_allclose(np.array(primvar.Get()), expected, rtol=1e-6)
    np.testing.assert_allclose(np.array(primvars.GetPrimvar("albedoSigma").Get()), values.sigma, rtol=1e-6)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert not [error.GetMessage() for error in errors if "license" not in error.GetMessage().lower()]


def test_a_cloud_before_two_cameras_is_no_surface_that_is_lit(scene: Scene, tmp_path: Path) -> None:
    """Behind it is nothing that a view saw."""
    exported = export(scene, tmp_path / "scene.ply", linear=True, albedo=True)
    assert exported.data()["albedo_known"] < 0.01
    assert np.isnan(ply_vertices(tmp_path / "scene.ply")["albedo_r"]).mean() > 0.99


@pytest.mark.parametrize(
    ("name", "options"), [("a.ply", {}), ("a.glb", {"linear": True}), ("a.html", {}), ("a.spz", {})]
)
def test_formats_that_do_not_hold_it_refuse(scene: Scene, tmp_path: Path, name: str, options: dict) -> None:
    with pytest.raises(InputError, match="--albedo is for linear light"):
        export(scene, tmp_path / name, albedo=True, **options)
    assert not list(tmp_path.iterdir())
