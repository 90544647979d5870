"""The cameras of a scene's views in OpenUSD: one for each camera, with time samples of what changes."""

from itertools import groupby
from typing import Any

from imaging.optics.pose import world_from_opengl
from recon.data.world import Vector
from recon.exports.target_coordinates import film_of
from recon.result.model import SceneView
from recon.result.scene import Scene
from recon.scene.usd_field import SIZE

_OF_MM = 0.01
"""Lenses in OpenUSD are in tenths of a unit, which is a metre here."""
_FAR = 1e6
"""Far end of what is drawn over its near end, which is the rasteriser's."""


def define_cameras(stage: Any, scene: Scene, offset: Vector) -> dict[str, str]:
    """Define /World/Cameras/NAME in a stage; the path of each camera by its name.

    What is the same in all frames of a camera is a plain value, as programs that look at no frame read it;
    what changes is animated, by the numbers of the frames, and has its first value besides.
    """
    from pxr import Tf, UsdGeom

    UsdGeom.Scope.Define(stage, "/World/Cameras")
    views = sorted(scene.views, key=lambda view: (view.camera, view.frame))
    paths: dict[str, str] = {}
    for name, camera_views in groupby(views, key=lambda view: view.camera):
        valid = base = Tf.MakeValidIdentifier(name)
        number = 1
        while f"/World/Cameras/{valid}" in paths.values():
            number += 1
            valid = f"{base}_{number}"
        paths[name] = f"/World/Cameras/{valid}"
        camera = UsdGeom.Camera.Define(stage, paths[name])
        camera.GetPrim().SetDisplayName(name)
        _set(camera, list(camera_views), scene, offset)
    frames = [view.frame for view in scene.views]
    if len(set(frames)) > 1:
        stage.SetStartTimeCode(min(frames))
        stage.SetEndTimeCode(max(frames))
        stage.SetTimeCodesPerSecond(24)
    return paths


def _set(camera: Any, views: list[SceneView], scene: Scene, offset: Vector) -> None:
    from pxr import Gf, Sdf

    near = scene.renderer.limits.near * scene.record.world.unit
    camera.CreateClippingRangeAttr(Gf.Vec2f(near, _FAR * near))
    place = camera.AddTransformOp()
    prim = camera.GetPrim()

    def custom_attribute(name: str, kind: Any) -> Any:
        return prim.CreateAttribute(name, kind, custom=True)

    values: dict[Any, list[Any]] = {
        camera.CreateFocalLengthAttr(): [],
        camera.CreateHorizontalApertureAttr(): [],
        camera.CreateVerticalApertureAttr(): [],
        camera.CreateHorizontalApertureOffsetAttr(): [],
        camera.CreateVerticalApertureOffsetAttr(): [],
        place.GetAttr(): [],
        custom_attribute("rig:lens:model", Sdf.ValueTypeNames.Token): [],
        custom_attribute("rig:lens:terms", Sdf.ValueTypeNames.DoubleArray): [],
        custom_attribute(SIZE, Sdf.ValueTypeNames.Int2): [],
    }
    for view in views:
        lens, film = view.lens, film_of(view.lens)
        motion = world_from_opengl(view.cam_from_world.matrix())
        motion[:3, 3] -= offset
        row = (
            _OF_MM * film.focal,
            _OF_MM * film.width,
            _OF_MM * film.height,
            _OF_MM * film.across,
            _OF_MM * film.up,
            Gf.Matrix4d(*motion.T.ravel().tolist()),
            "OPENCV_FISHEYE" if lens.fisheye else "OPENCV",
            list(lens.terms),
            Gf.Vec2i(lens.width, lens.height),
        )
        for column, value in zip(values.values(), row, strict=True):
            column.append(value)
    for attribute, column in values.items():
        attribute.Set(column[0])
        if any(value != column[0] for value in column):
            for view, value in zip(views, column, strict=True):
                attribute.Set(value, view.frame)
