"""What was found out about a session, put together as the record that is written."""

from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from math import degrees, hypot
from statistics import median
from typing import Literal

from calib.boards.measure import Measured
from calib.data.views import View
from calib.light import vignetting
from calib.light.radiometry import Light
from calib.poses import sfm
from calib.sensor import metadata
from calib.sensor.metadata import Sensor
from imaging.files import store
from imaging.session.calibration import (
    CalibrationRecord,
    CameraCalibration,
    LensError,
    PoseError,
    Response,
    ViewCalibration,
)
from imaging.session.records import Rung
from imaging.session.session import Session
from imaging.session.view_id import ViewId


def assemble(
    session: Session,
    views: Sequence[View],
    found: Mapping[str, Sensor],
    light: Light,
    model: sfm.Model | None = None,
    falloff: vignetting.Falloff | None = None,
    board: Measured | None = None,
    by_rig: Collection[ViewId] = (),
) -> CalibrationRecord:
    """What is written; without a model no poses, and lenses only as far as a board told them.

    by_rig: the views of the model that nothing but their rig placed.
    """
    cameras = []
    for camera in session.record.cameras:
        own = found.get(camera.name)
        update: dict[str, object] = {}
        if own is not None:
            update |= {
                "noise": own.noise,
                "sensors": own.measured.at,
                "camera_from_rec709": own.camera_from_rec709,
            }
        posed = model is not None and camera.name in model.lenses
        sure = board is not None and (not posed or camera.name in board.sure_lenses)
        if board is not None and sure and camera.name in board.lenses:
            update |= {
                "lens": board.lenses[camera.name],
                "lens_error": board.lens_errors.get(camera.name),
                "cam_from_rig": board.cam_from_rig.get(camera.name),
                "cam_from_rig_error": board.rig_errors.get(camera.name),
            }
        if own is not None and model is not None and falloff is not None and camera.name in model.lenses:
            size = (own.lens.width, own.lens.height)
            if "lens" not in update:
                update["lens"] = model.lenses[camera.name].resized(*size)
                update["lens_error"] = _lens_error(model, camera.name, *size)
            update |= {
                "cam_from_rig": model.cam_from_rig.get(camera.name),
                "cam_from_rig_error": _rig_error(model, camera.name, board),
                "vignetting": falloff.vignetting[camera.name],
                "gain": falloff.gain[camera.name],
            }
        if own is not None and own.measured.falloff is not None:
            update["vignetting"] = own.measured.falloff.vignetting
        blank_kind: Literal["linear", "srgb"] = "linear" if camera.kind == "raw" else "srgb"
        no_images = Response(kind=blank_kind, evidence="it has no images of a scene")
        response = light.responses.get(camera.name, no_images)
        blank = CameraCalibration(name=camera.name, serial=camera.serial, response=response)
        cameras.append(blank.model_copy(update=update))
    poses = {} if model is None else model.poses
    raw = {name: own for name, own in found.items() if session.camera(name).kind == "raw"}
    rungs: tuple[Rung, ...] = (*metadata.rungs(raw), *light.rungs)
    if model is not None and falloff is not None:
        rungs = (*rungs, *model.rungs, *falloff.rungs)
    if board is not None:
        rungs = (*rungs, *board.rungs)
    return CalibrationRecord(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "pycolmap", "numpy")},
        shots_sha256=store.sha256(session.folder / "shots.jsonl"),
        cameras=tuple(cameras),
        views=tuple(
            ViewCalibration(
                camera=view.camera,
                frame=view.frame,
                cam_from_world=pose,
                points=model.points[view] if model else 0,
                error=_pose_error(model, view, board),
                by_rig=view in by_rig,
            )
            for view, pose in sorted(poses.items())
        ),
        unregistered=tuple(sorted(view.id for view in views if view.id not in poses)),
        contradicted=() if model is None else tuple(sorted(model.contradicted)),
        unit="m"
        if (board is not None and model is None) or (model is not None and model.metric)
        else "relative",
        board=None if board is None else board.evidence,
        points=0 if model is None else int(model.reconstruction.num_points3D()),
        reprojection_px=None if model is None else model.reprojection_px,
        exposure_scale=light.scale,
        rungs=rungs,
    )


def _lens_error(model: sfm.Model, name: str, width: int, height: int) -> LensError | None:
    """Standard errors at the size of the images; the model's are those of its pictures."""
    if model.spread is None or name not in model.spread.lenses:
        return None
    terms = dict(model.spread.lenses[name])
    for axis, factor in (("x", width / model.lenses[name].width), ("y", height / model.lenses[name].height)):
        terms[f"f{axis}"] *= factor
        terms[f"c{axis}"] *= factor
    return LensError.model_validate(terms)


def _rig_error(model: sfm.Model, name: str, board: Measured | None) -> PoseError | None:
    """A board's where its rig was kept; else that of the camera's views, which the rig makes all alike."""
    if name not in model.cam_from_rig:
        return None
    if board is not None and board.sure_rig:
        return board.rig_errors.get(name)
    errors = [_pose_error(model, view, None) for view in model.poses if view.camera == name]
    known = [error for error in errors if error is not None]
    if not known:
        return None
    return PoseError(
        rotation=median(error.rotation for error in known),
        translation=median(error.translation for error in known),
    )


def _pose_error(model: sfm.Model | None, view: ViewId, board: Measured | None) -> PoseError | None:
    """From the scene, and from lens and rig where a board told them and they were kept."""
    if model is None or model.spread is None or view not in model.spread.rotation:
        return None
    rotation, translation = model.spread.rotation[view], model.spread.translation[view]
    if board is not None and view.camera in board.sure_lenses:
        lens, error = board.lenses[view.camera], board.lens_errors[view.camera]
        rotation = hypot(rotation, degrees(max(error.cx / lens.fx, error.cy / lens.fy)))
    if board is not None and board.sure_rig and view.camera in board.rig_errors:
        mounted = board.rig_errors[view.camera]
        rotation, translation = hypot(rotation, mounted.rotation), hypot(translation, mounted.translation)
    return PoseError(rotation=rotation, translation=translation)
