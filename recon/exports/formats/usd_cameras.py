"""The cameras of a scene's views in OpenUSD: one for each camera, with a time sample for each frame."""

from itertools import groupby
from typing import Any

import numpy as np

from imaging.files.nerfstudio import OPENGL_FROM_OPENCV
from recon.data.world import Vector
from recon.result.model import SceneView
from recon.result.scene import Scene

FILM = 36.0
"""Width that every film is given: only the ratios of focal length, film and offsets mean anything."""
_FAR = 1e6
"""Far end of what is drawn over its near end, which is the rasteriser's."""


def define_cameras(stage: Any, scene: Scene, offset: Vector) -> dict[str, str]:
    """Define /World/Cameras/NAME in a stage; the path of each camera by its name.

    A camera of one view has plain values, one of several is animated: time codes are the numbers of frames.
    """
    from pxr import Tf, UsdGeom

    UsdGeom.Scope.Define(stage, "/World/Cameras")
    views = sorted(scene.views, key=lambda view: (view.camera, view.frame))
    paths: dict[str, str] = {}
    for name, own in groupby(views, key=lambda view: view.camera):
        valid = base = Tf.MakeValidIdentifier(name)
        number = 1
        while f"/World/Cameras/{valid}" in paths.values():
            number += 1
            valid = f"{base}_{number}"
        paths[name] = f"/World/Cameras/{valid}"
        camera = UsdGeom.Camera.Define(stage, paths[name])
        camera.GetPrim().SetDisplayName(name)
        _set(camera, list(own), scene, offset)
    frames = [view.frame for view in scene.views]
    if len(set(frames)) > 1:
        stage.SetStartTimeCode(min(frames))
        stage.SetEndTimeCode(max(frames))
        stage.SetTimeCodesPerSecond(24)
    return paths


def _set(camera: Any, views: list[SceneView], scene: Scene, offset: Vector) -> None:
    from pxr import Gf, Sdf, Usd

    near = scene.renderer.limits.near * scene.record.world.unit
    camera.CreateClippingRangeAttr(Gf.Vec2f(near, _FAR * near))
    place = camera.AddTransformOp()
    attributes = {
        "focal": camera.CreateFocalLengthAttr(),
        "width": camera.CreateHorizontalApertureAttr(),
        "height": camera.CreateVerticalApertureAttr(),
        "right": camera.CreateHorizontalApertureOffsetAttr(),
        "up": camera.CreateVerticalApertureOffsetAttr(),
    }
    prim = camera.GetPrim()
    model = prim.CreateAttribute("rig:lens:model", Sdf.ValueTypeNames.Token, custom=True)
    terms = prim.CreateAttribute("rig:lens:terms", Sdf.ValueTypeNames.DoubleArray, custom=True)
    size = prim.CreateAttribute("rig:lens:size", Sdf.ValueTypeNames.Int2, custom=True)
    for view in views:
        time = Usd.TimeCode(view.frame) if len(views) > 1 else Usd.TimeCode.Default()
        lens = view.lens
        focal = FILM * lens.fx / lens.width
        values = {
            "focal": focal,
            "width": FILM,
            "height": focal * lens.height / lens.fy,
            "right": focal * (lens.width / 2 - lens.cx) / lens.fx,
            "up": focal * (lens.cy - lens.height / 2) / lens.fy,
        }
        for name, attribute in attributes.items():
            attribute.Set(values[name], time)
        motion = np.linalg.inv(view.cam_from_world.matrix()) @ OPENGL_FROM_OPENCV
        motion[:3, 3] -= offset
        place.Set(Gf.Matrix4d(*motion.T.ravel().tolist()), time)
        model.Set("OPENCV_FISHEYE" if lens.fisheye else "OPENCV", time)
        terms.Set(list(lens.terms), time)
        size.Set(Gf.Vec2i(lens.width, lens.height), time)
