"""OpenUSD: a `ParticleField3DGaussianSplat` of scene-linear light, the cameras of the views, a dome light.

Colours are linear Rec.709 radiance times a factor that the file states, by default what shows the median of
the scene as middle grey. Float32 as in the scene: what it loses is the rounding, beside one half, of light
far below the factor's middle (`recon.exports.loss`). Cameras have no distortion here.
"""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from imaging.arrays import Array, Array32
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr.writing import write_exr
from recon.albedo.estimate import Albedo
from recon.exports.formats.usd_cameras import define_cameras
from recon.exports.job import Job, Written, lens_note
from recon.exports.splats import Splats, exposure_factor, far_light_of
from recon.exports.target_coordinates import Place
from recon.result.display import in_colour
from recon.result.model import ENVIRONMENT
from recon.result.scene import Scene
from recon.scene.environment import Environment
from recon.scene.usd_field import PLACED, require_usd

SUFFIXES = (".usd", ".usda", ".usdc")
COLOUR_SPACE = "lin_rec709_scene"
"""Name of a colour space from the ASWF Color Interop Forum, which OpenUSD takes its names from."""
_REACH = 3.0
"""Standard deviations to which a Gaussian counts for the extent."""


def write(job: Job) -> Written:
    """Write the file, as a writer of `rig export`."""
    splats = job.splats(with_dome=False)
    files = write_usd(job.out, job.scene, splats, job.place, job.albedo)
    return Written(files, splats.in_single(), splats, lens_note(job.scene))


def write_usd(
    path: Path, scene: Scene, splats: Splats, place: Place, albedo: Albedo | None = None
) -> list[Path]:
    """Write the scene, and beside it the map of its environment, if it has one; the files written.

    splats: of linear light, without a dome. albedo: of each of them, as primvars.
    InputError unless the name ends in .usd, .usda or .usdc.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path} is not the name of a USD file: end it in .usd, .usdc or .usda.")
    require_usd()
    from pxr import Gf, Sdf, Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if place.z_up else UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    colour = Usd.ColorSpaceAPI.Apply(world.GetPrim())
    colour.CreateColorSpaceNameAttr(COLOUR_SPACE)
    world.AddTransformOp().Set(_matrix(place.turn))
    marker = world.GetPrim().CreateAttribute(PLACED, Sdf.ValueTypeNames.Double3, custom=True)
    marker.Set(Gf.Vec3d(*scene.left_out))
    field = _define_splats(stage, splats)
    if albedo is not None:
        _define_albedo(field, albedo, splats.factor)
    define_cameras(stage, scene, splats.offset)
    files = [path]
    if (far := far_light_of(scene)) is not None:
        sky = path.with_name(f"{path.stem}.{ENVIRONMENT}")
        _write_sky(sky, scene, far, splats.factor)
        _define_dome(stage, far, sky.name)
        files.append(sky)
    layer = stage.GetRootLayer()
    layer.customLayerData = {"rig": _facts(scene, splats, place)}
    layer.documentation = _documentation(scene, splats, place)
    kind = "usda" if path.suffix.lower() == ".usda" else "usdc"
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / f"scene.{kind}"
        if not layer.Export(str(made)):
            raise InputError(f"{path} could not be written by OpenUSD: free some space in {folder}.")
        store.write_bytes(path, made.read_bytes())
    return files


def _define_splats(stage: Any, splats: Splats) -> Any:
    from pxr import Gf, UsdVol, Vt

    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/World/Splats")
    floats = Vt.Vec3fArray.FromNumpy
    field.CreatePositionsAttr(floats(_single(splats.means)))
    field.CreateScalesAttr(floats(_single(splats.scales)))
    xyzw = _single(splats.quats)[:, [1, 2, 3, 0]]  # as Gf has them in memory
    field.CreateOrientationsAttr(Vt.QuatfArray.FromNumpy(np.ascontiguousarray(xyzw)))
    field.CreateOpacitiesAttr(Vt.FloatArray.FromNumpy(_single(splats.opacities)))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(splats.degree)
    coefficients = field.CreateRadianceSphericalHarmonicsCoefficientsAttr(
        floats(_single(splats.harmonics.reshape(-1, 3)))
    )
    coefficients.SetColorSpace(COLOUR_SPACE)
    reach = _REACH * splats.scales.max(axis=1, keepdims=True)
    low, high = (splats.means - reach).min(0), (splats.means + reach).max(0)
    field.CreateExtentAttr([Gf.Vec3f(*low.tolist()), Gf.Vec3f(*high.tolist())])
    field.CreateProjectionModeHintAttr(UsdVol.Tokens.perspective)
    field.CreateSortingModeHintAttr(UsdVol.Tokens.zDepth)
    return field


def _define_albedo(field: Any, albedo: Albedo, factor: float) -> None:
    """Primvars `albedo`, `irradiance` (as the radiance of the file is) and `albedoSigma`; NaN: not known."""
    from pxr import Sdf, UsdGeom, Vt

    primvars = UsdGeom.PrimvarsAPI(field)
    for name, values in (("albedo", albedo.albedo), ("irradiance", factor * albedo.irradiance)):
        primvar = primvars.CreatePrimvar(name, Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
        primvar.Set(Vt.Vec3fArray.FromNumpy(_single(values)))
        primvar.GetAttr().SetColorSpace(COLOUR_SPACE)
    primvar = primvars.CreatePrimvar("albedoSigma", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.FloatArray.FromNumpy(_single(albedo.sigma)))


def _write_sky(path: Path, scene: Scene, far: Environment, factor: float) -> None:
    """The light from far away in the unit of the Gaussians, in the layout of OpenEXR."""
    light = far.ln_light.exp().movedim(0, 2).numpy()
    shown = in_colour((light * factor).astype(np.float32), scene.record.bands)
    write_exr(path, shown, attributes={"rig:values": f"linear Rec.709 radiance times {factor:.9g}"})


def _define_dome(stage: Any, far: Environment, name: str) -> None:
    """A dome light, whose map is laid out as OpenEXR has it, as `Environment` is: y up, z in its middle."""
    from pxr import UsdLux

    dome = UsdLux.DomeLight.Define(stage, "/World/Environment")
    dome.CreateTextureFileAttr(f"./{name}")
    dome.CreateTextureFormatAttr(UsdLux.Tokens.latlong)
    dome.CreateIntensityAttr(1.0)
    dome.AddTransformOp().Set(_matrix(far.axes.T))


def _facts(scene: Scene, splats: Splats, place: Place) -> dict[str, Any]:
    record = scene.record
    facts: dict[str, Any] = {
        "exposureFactor": exposure_factor(scene, splats.factor),
        "radiance": record.radiance,
        "coordinates": place.note,
        "lengthUnit": "m" if place.metres else "unknown",
        "offset": ",".join(repr(part) for part in scene.left_out),
        "kernelVariancePx": scene.renderer.limits.blur,
    }
    if record.luminance is not None:
        value, error = record.luminance
        facts |= {"whiteLuminance": value / splats.factor, "whiteLuminanceError": error / splats.factor}
    if record.bands:
        facts["falseColourOf"] = ", ".join(band.name for band in record.bands)
    return facts


def _documentation(scene: Scene, splats: Splats, place: Place) -> str:
    lines = [
        f"Linear Rec.709 radiance ({scene.record.radiance}) times {splats.factor:.6g}.",
        f"Coordinates: {place.note}.",
    ]
    if scene.record.luminance is not None:
        lines.append(f"A colour of (1, 1, 1) is {scene.record.luminance[0] / splats.factor:.6g} cd/m2.")
    if not place.metres:
        lines.append("The unit of length is not known; metersPerUnit 1 is a guess.")
    if any(scene.left_out):
        lines.append("World coordinates are these plus ({!r}, {!r}, {!r}).".format(*scene.left_out))
    return " ".join(lines)


def _matrix(turn: Array) -> Any:
    """A turn [3, 3] of column vectors as Gf has it, whose vectors are rows."""
    from pxr import Gf

    whole = np.eye(4)
    whole[:3, :3] = turn.T
    return Gf.Matrix4d(*whole.ravel().tolist())


def _single(values: Array) -> Array32:
    return np.ascontiguousarray(values, np.float32)
