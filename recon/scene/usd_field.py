"""Gaussians and cameras of OpenUSD files of any program: `ParticleField3DGaussianSplat`."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from imaging.arrays import Array
from imaging.errors import InputError
from imaging.files.tags.exr_colour import INTEROP_ID, colour_of
from imaging.optics.lens import Lens
from imaging.optics.pose import OPENGL_FROM_OPENCV
from recon.data.world import Vector
from recon.scene.harmonics import C0
from recon.scene.ply_file import PlySplats

_WIDTH = 640
"""Width, px, of a camera whose file states no size, as those of OpenUSD do not."""
_MOST_VIEWS = 500
PLACED = "userProperties:rigOffset"
"""Attribute of the prim that represents the world of a calibration in a stage of `rig export`: double3, the
offset to add to its coordinates for those of the calibration. Blender keeps attributes of this name.
"""
SIZE = "rig:lens:size"
"""Attribute of the cameras of `rig export`: width and height of the picture, px."""


@dataclass(frozen=True, eq=False)
class UsdCamera:
    """A camera at a time. prim: its path in the stage; name: as users see it, which several can have.
    cam_from_field: float64 [4, 4], a motion in the coordinates of the Gaussians.
    """

    prim: str
    name: str
    frame: int
    lens: Lens
    cam_from_field: Array


@dataclass(frozen=True, eq=False)
class UsdField:
    """The Gaussians of a file. linear: whether colours are linear light, of Rec.709; up: the way up, a unit
    vector. offset: what `rig export` states to add to their coordinates for those of a calibration.
    """

    splats: PlySplats
    linear: bool
    up: Array
    cameras: tuple[UsdCamera, ...]
    offset: Vector


def require_usd() -> None:
    """InputError where OpenUSD's Python is not installed, or too old for splats."""
    try:
        from pxr import UsdVol
    except ImportError as error:
        raise InputError("USD files need usd-core 26.3 or later: `pip install -e '.[usd]'`.") from error
    if not hasattr(UsdVol, "ParticleField3DGaussianSplat"):
        raise InputError("USD splats need usd-core 26.3 or later: run `pip install -U 'usd-core>=26.3'`.")


def read_usd(path: Path) -> UsdField:
    """The one field of Gaussians of a file and its cameras.

    Of Gaussians that change it is the first moment. Colours whose space the file does not call linear are
    display values. InputError for a file that OpenUSD cannot open, that has no such field, or several, and
    for light of an unknown space.
    """
    require_usd()
    from pxr import Tf, Usd, UsdGeom, UsdVol

    if not path.is_file():
        raise InputError(f"{path} cannot be read: correct the path.")
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"{path} cannot be opened by OpenUSD: export it again.") from error
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdVol.ParticleField3DGaussianSplat)]
    if len(prims) != 1:
        count = f"{len(prims)} fields" if prims else "no field"
        raise InputError(f"{path} has {count} of Gaussians: export one ParticleField3DGaussianSplat.")
    field = UsdVol.ParticleField3DGaussianSplat(prims[0])
    placed = column_matrix(UsdGeom.Xformable(field).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime()))
    unit = abs(float(np.linalg.det(placed[:3, :3]))) ** (1 / 3)
    turn = placed[:3, :3] / max(unit, 1e-300)
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-4) or np.linalg.det(turn) < 0:
        raise InputError(
            f"{path} stretches or mirrors its Gaussians: bake the transform of {prims[0].GetPath()}."
        )
    axis = [0.0, 0.0, 1.0] if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else [0.0, 1.0, 0.0]
    cameras: list[UsdCamera] = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Camera):
            cameras += _cameras(UsdGeom.Camera(prim), placed[:3, 3], turn, unit)
    space = _space(field)
    splats, linear = _splats(path, field), space.startswith("lin_")
    if linear:
        splats = replace(splats, harmonics=_in_rec709(path, splats.harmonics, space))
    return UsdField(splats, linear, turn.T @ axis, tuple(cameras[:_MOST_VIEWS]), _offset(prims[0], placed))


def _splats(path: Path, field: Any) -> PlySplats:
    means = _values(field.GetPositionsAttr(), field.GetPositionshAttr(), 3)
    count = len(means)
    if not count:
        raise InputError(f"{path} holds no Gaussian: export it again.")
    quats = _first(field.GetOrientationsAttr()) or _first(field.GetOrientationshAttr()) or []
    scales = _values(field.GetScalesAttr(), field.GetScaleshAttr(), 3)
    opacities = _values(field.GetOpacitiesAttr(), field.GetOpacitieshAttr(), 1)[:, 0]
    degree = int(_first(field.GetRadianceSphericalHarmonicsDegreeAttr()))
    harmonics = _values(
        field.GetRadianceSphericalHarmonicsCoefficientsAttr(),
        field.GetRadianceSphericalHarmonicsCoefficientshAttr(),
        3,
    )
    sizes = (len(quats), len(scales), len(opacities), len(harmonics) / (degree + 1) ** 2)
    if not 0 <= degree <= 3 or any(size != count for size in sizes):
        raise InputError(f"{path} has arrays of different lengths for its Gaussians: export it again.")
    with np.errstate(divide="ignore", invalid="ignore"):
        logits = np.log(opacities) - np.log1p(-opacities.clip(None, 1 - 2.0**-25))
        log_scales = np.log(scales)
    return PlySplats(
        means=means,
        log_scales=log_scales,
        quats=np.array([(q.real, *q.imaginary) for q in quats], np.float64).reshape(-1, 4),
        logits=logits,
        harmonics=harmonics.reshape(count, -1, 3),
        comments=(),
    )


def _in_rec709(path: Path, harmonics: Array, space: str) -> Array:
    """Harmonics [N, K, 3] of linear light in a space as those of Rec.709, one half being added to both."""
    colour = colour_of({INTEROP_ID: space})
    if colour.doubt:
        raise InputError(
            f"{path} has light in {space:.60}, which rig does not know: export it in lin_rec709_scene."
        )
    if colour.matrix is None:
        return harmonics
    half = np.zeros((1, harmonics.shape[1], 1))
    half[:, 0] = 0.5 / C0
    return np.asarray((harmonics + half) @ colour.matrix.T - half)


def _values(single: Any, half: Any, width: int) -> Array:
    """Values of an attribute in either precision, [N, width]; none where the file has neither."""
    values = _first(single)
    if values is None:
        values = _first(half)
    return np.array([] if values is None else values, np.float64).reshape(-1, width)


def _first(attribute: Any) -> Any:
    """The value of an attribute, of one that is animated the first; None: it has none."""
    from pxr import Usd

    return attribute.Get(Usd.TimeCode.EarliestTime())


def _offset(prim: Any, placed: Array) -> Vector:
    """The offset of the prim above a field that represents its world; 0 where the field moved against it."""
    from pxr import Usd, UsdGeom

    while prim and not prim.IsPseudoRoot():
        value = _first(prim.GetAttribute(PLACED)) if prim.HasAttribute(PLACED) else None
        if value is not None:
            at = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.EarliestTime())
            x, y, z = map(float, value)
            stands = np.allclose(column_matrix(at), placed, rtol=1e-6, atol=1e-6)
            return (x, y, z) if stands and np.isfinite([x, y, z]).all() else (0.0, 0.0, 0.0)
        prim = prim.GetParent()
    return (0.0, 0.0, 0.0)


def _space(field: Any) -> str:
    """Name of the colour space, empty if unstated."""
    from pxr import Usd

    attribute = field.GetRadianceSphericalHarmonicsCoefficientsAttr()
    if attribute.HasColorSpace():
        return str(attribute.GetColorSpace())
    prim = field.GetPrim()
    while prim and not prim.IsPseudoRoot():
        if prim.HasAPI(Usd.ColorSpaceAPI):
            return str(Usd.ColorSpaceAPI(prim).GetColorSpaceNameAttr().Get() or "")
        prim = prim.GetParent()
    return ""


def _cameras(camera: Any, shift: Array, turn: Array, unit: float) -> list[UsdCamera]:
    """A camera at each of its times, its axes as OpenCV has them; those of no perspective are left out."""
    from pxr import Usd

    times = times_of(camera)
    rounded = [max(0, round(time)) for time in times]
    frames = rounded if len(set(rounded)) == len(times) else list(range(len(times)))
    size_attribute = camera.GetPrim().GetAttribute(SIZE)
    cameras = []
    for frame, time in zip(frames or [0], times or [Usd.TimeCode.Default()], strict=True):
        gf = camera.GetCamera(time)
        if gf.projection != gf.Perspective or not gf.focalLength > 0 or not gf.verticalAperture > 0:
            continue
        size = size_attribute.Get(time) if size_attribute else None
        lens = Lens(model="PINHOLE", **pinhole_numbers(gf, *(size or (_WIDTH, None))))
        pose = column_matrix(gf.transform) @ OPENGL_FROM_OPENCV
        centre = turn.T @ (pose[:3, 3] - shift) / unit
        motion = np.eye(4)
        motion[:3, :3] = unscaled(pose[:3, :3]).T @ turn
        motion[:3, 3] = -motion[:3, :3] @ centre
        prim = camera.GetPrim()
        name = prim.GetDisplayName() or prim.GetName()
        cameras.append(UsdCamera(str(prim.GetPath()), name, frame, lens, motion))
    return cameras


def times_of(camera: Any) -> list[float]:
    """Times at which a camera moves, or a prim above it, as Blender does it, or its lens changes."""
    from pxr import UsdGeom

    times = {
        time
        for attribute in (
            camera.GetProjectionAttr(),
            camera.GetFocalLengthAttr(),
            camera.GetHorizontalApertureAttr(),
            camera.GetVerticalApertureAttr(),
            camera.GetHorizontalApertureOffsetAttr(),
            camera.GetVerticalApertureOffsetAttr(),
        )
        for time in attribute.GetTimeSamples()
    }
    prim = camera.GetPrim()
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            times.update(UsdGeom.Xformable(prim).GetTimeSamples())
        prim = prim.GetParent()
    return sorted(times)


def pinhole_numbers(gf: Any, width: int, height: int | None) -> dict[str, Any]:
    """Width, height, fx, fy, cx and cy, px, of a GfCamera; without a height pixels are square.

    Lengths of its lens share one unit, which therefore does not matter.
    """
    fx = width * gf.focalLength / gf.horizontalAperture
    if height is None:
        height, fy = max(1, round(width * gf.verticalAperture / gf.horizontalAperture)), fx
    else:
        fy = height * gf.focalLength / gf.verticalAperture
    return {
        "width": width,
        "height": height,
        "fx": fx,
        "fy": fy,
        "cx": width / 2 - fx * gf.horizontalApertureOffset / gf.focalLength,
        "cy": height / 2 + fy * gf.verticalApertureOffset / gf.focalLength,
    }


def unscaled(turn: Array) -> Array:
    """A rotation [3, 3] times a number, without the number: that of a unit other than the world's."""
    return np.asarray(turn / np.cbrt(np.linalg.det(turn)))


def column_matrix(matrix: Any) -> Array:
    """A matrix of Gf, whose vectors are rows, for columns."""
    return np.array(matrix, np.float64).reshape(4, 4).T
