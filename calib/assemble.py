"""Assembly of a calibration's record from its measurements."""

from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from math import degrees, hypot
from statistics import median
from typing import Literal

import numpy as np

from calib.boards.measure import MeasuredBoard
from calib.colour import unfiltered
from calib.colour.colour_record import with_balance, with_charts, with_development
from calib.evidence import Evidence
from calib.measures import Measures
from calib.place_views import Placement
from calib.poses.sfm import SceneModel, pose_of
from calib.scene_light import SceneLight
from calib.sensor import metadata
from calib.sensor.metadata import CameraSensor
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.session.calibration import (
    COLOUR,
    CalibrationRecord,
    CameraCalibration,
    LensError,
    PoseError,
    Response,
    ViewCalibration,
)
from imaging.session.records import CameraRecord, Rung
from imaging.session.view_id import ViewId

_STATED = ("noise", "camera_from_rec709")
"""Fields that the files of a camera may state, so that no calibration has to measure them."""
_STATED_RUNGS = frozenset({"sensor_noise", COLOUR})


def assemble(
    evidence: Evidence, placement: Placement | None = None, light: SceneLight | None = None
) -> CalibrationRecord:
    """Assemble what is written of a session.

    Args:
        evidence: Measurements that need no pose.
        placement: Placed views; None: there are no poses, and lenses only as far as a board gave them.
        light: Light of the placed scene.

    Returns:
        The record, without a scale of its light.
    """
    session, board = evidence.session, evidence.board
    model = None if placement is None else placement.model
    poses = {} if model is None else model.poses
    metric = board is not None if model is None else model.metric
    record = CalibrationRecord(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "pycolmap", "numpy")},
        shots_sha256=store.sha256(session.folder / "shots.jsonl"),
        cameras=tuple(_camera(camera, evidence, model, light) for camera in session.record.cameras),
        views=() if placement is None else _views(placement, board),
        unregistered=tuple(sorted(view.id for view in evidence.views if view.id not in poses)),
        contradicted=() if model is None else tuple(sorted(model.contradicted)),
        unit="m" if metric else "relative",
        coordinates=None if placement is None else placement.coordinates,
        board=None if board is None else board.evidence,
        points=0 if model is None else int(model.reconstruction.num_points3D()),
        reprojection_px=None if model is None else model.reprojection_px,
        exposure_scale=evidence.light.scale,
        rungs=_rungs(evidence, model, light),
    )
    record = with_charts(record, evidence.charts)
    if light is None:
        return record
    record = with_balance(record, light.white)
    return (
        record if light.development is None else with_development(record, light.development, evidence.views)
    )


def with_part(evidence: Evidence, measures: Measures) -> CalibrationRecord:
    """The earlier calibration with one part measured again; without one, that part and what it needs."""
    fresh, earlier = assemble(replace(evidence, views=())), evidence.earlier
    if earlier is None:
        return fresh
    # Poses that were given came without a look at what the files say of the cameras themselves.
    stated = not any(rung.name == COLOUR for rung in earlier.rungs)
    names = measures.rungs | (_STATED_RUNGS if stated else frozenset())
    cameras = []
    for camera in earlier.cameras:
        sensor = evidence.sensors.get(camera.name)
        flat = measures.sensors and sensor is not None and sensor.measured.falloff is not None
        fields = (*measures.fields, *(_STATED if stated else ()), *(("vignetting",) if flat else ()))
        new = fresh.camera(camera.name)
        cameras.append(camera.model_copy(update={field: getattr(new, field) for field in fields}))
    others = [rung for rung in earlier.rungs if rung.name not in names]
    update: dict[str, object] = {
        "created": fresh.created,
        "versions": fresh.versions,
        "cameras": tuple(cameras),
        "rungs": (*(rung for rung in fresh.rungs if rung.name in names), *others),
    }
    if "response" in measures.fields:
        developed = {view.id: view.exposure for view in earlier.views}
        update["exposure_scale"] = {
            shot.file: fresh.exposure_scale[shot.file] * developed.get(view.id, 1.0)
            for view in evidence.views
            for shot in view.shots
        }
    return earlier.model_copy(update=update)


def _camera(
    camera: CameraRecord, evidence: Evidence, model: SceneModel | None, light: SceneLight | None
) -> CameraCalibration:
    """Calibration of one camera from all sources; a later one overrides an earlier."""
    name, board = camera.name, evidence.board
    sensor = evidence.sensors.get(name)
    update: dict[str, object] = {}
    posed = model is not None and name in model.lenses
    if model is not None and posed and sensor is not None:
        update |= _lens_of_scene(model, name, sensor)
    if board is not None and name in board.lenses and (not posed or name in board.sure_lenses):
        update |= _of_board(board, name)
        if model is not None and not posed:
            update |= _in_tied_rig(camera, evidence, model, board)
    if model is not None and posed and sensor is not None:
        update["cam_from_rig"] = model.cam_from_rig.get(name)
        update["cam_from_rig_error"] = _rig_error(model, name, board)
    if light is not None and posed and sensor is not None:
        update |= {"vignetting": light.falloff.vignetting[name], "gain": light.falloff.gain[name]}
    if sensor is not None:
        update |= _of_sensor(sensor)
    kind: Literal["linear", "srgb"] = "linear" if camera.kind == "raw" else "srgb"
    no_images = Response(kind=kind, evidence="it has no images of a scene")
    response = evidence.light.responses.get(name, no_images)
    calibration = CameraCalibration(name=name, serial=camera.serial, response=response)
    return calibration.model_copy(update=update)


def _of_sensor(sensor: CameraSensor) -> dict[str, object]:
    flat = sensor.measured.falloff
    return {
        "noise": sensor.noise,
        "sensors": sensor.measured.at,
        "camera_from_rec709": sensor.camera_from_rec709,
        **({} if flat is None else {"vignetting": flat.vignetting}),
    }


def _of_board(board: MeasuredBoard, name: str) -> dict[str, object]:
    return {
        "lens": board.lenses[name],
        "lens_error": board.lens_errors.get(name),
        "cam_from_rig": board.cam_from_rig.get(name),
        "cam_from_rig_error": board.rig_errors.get(name),
    }


def _in_tied_rig(
    camera: CameraRecord, evidence: Evidence, model: SceneModel, board: MeasuredBoard
) -> dict[str, object]:
    """Place of a camera without a view in the rig that the model ties, by way of a camera that is in both.

    The board's rig may have another reference than the model's. Nothing where the model ties no such rig; no
    place where it is not in metres, or no camera is in both.
    """
    name = camera.name
    mates = [other.name for other in evidence.session.record.cameras if other.rig == camera.rig]
    tied = [other for other in mates if camera.rig is not None and other in model.cam_from_rig]
    common = [other for other in tied if other in board.cam_from_rig]
    if not tied:
        return {}
    if not model.metric or not common or name not in board.cam_from_rig:
        return {"cam_from_rig": None, "cam_from_rig_error": None}
    other = min(common, key=lambda mate: mate in model.by_motion)
    across = board.cam_from_rig[name].matrix() @ np.linalg.inv(board.cam_from_rig[other].matrix())
    return {
        "cam_from_rig": pose_of(pycolmap.Rigid3d((across @ model.cam_from_rig[other].matrix())[:3])),
        # Where the scene moved the other camera, the board's error is not all of it.
        "cam_from_rig_error": board.rig_errors.get(name) if board.sure_rig else None,
    }


def _lens_of_scene(model: SceneModel, name: str, sensor: CameraSensor) -> dict[str, object]:
    size = (sensor.lens.width, sensor.lens.height)
    return {"lens": model.lenses[name].resized(*size), "lens_error": _lens_error(model, name, *size)}


def _views(placement: Placement, board: MeasuredBoard | None) -> tuple[ViewCalibration, ...]:
    model = placement.model
    return tuple(
        ViewCalibration(
            camera=view.camera,
            frame=view.frame,
            cam_from_world=pose,
            points=model.points[view],
            error=_pose_error(model, view, board),
            by_rig=view in placement.by_rig,
        )
        for view, pose in sorted(model.poses.items())
    )


def _rungs(evidence: Evidence, model: SceneModel | None, light: SceneLight | None) -> tuple[Rung, ...]:
    session, board = evidence.session, evidence.board
    raw = {name: sensor for name, sensor in evidence.sensors.items() if session.camera(name).kind == "raw"}
    return (
        *metadata.rungs(raw),
        *unfiltered.rungs(raw),
        *evidence.light.rungs,
        *(() if model is None else model.rungs),
        *(() if light is None else light.falloff.rungs),
        *(() if board is None else board.rungs),
    )


def _lens_error(model: SceneModel, name: str, width: int, height: int) -> LensError | None:
    """Standard errors at the size of the images; the model's are those of its pictures."""
    if model.errors is None or name not in model.errors.lenses:
        return None
    terms = dict(model.errors.lenses[name])
    for axis, factor in (("x", width / model.lenses[name].width), ("y", height / model.lenses[name].height)):
        terms[f"f{axis}"] *= factor
        terms[f"c{axis}"] *= factor
    return LensError.model_validate({**terms, "focal_untold": name in model.focal_held})


def _rig_error(model: SceneModel, name: str, board: MeasuredBoard | None) -> PoseError | None:
    """A board's where its rig was kept; else that of the camera's views, which the rig makes all alike.

    Where motion ties cameras together, views of one are sure of each other and not of those of the other.
    """
    if name not in model.cam_from_rig:
        return None
    if board is not None and board.sure_rig:
        return board.rig_errors.get(name)
    if model.by_motion and model.errors is not None and name in model.errors.mounted:
        turn, shift = model.errors.mounted[name]
        return PoseError(rotation=turn, translation=shift)
    every = [_pose_error(model, view, None) for view in model.poses if view.camera == name]
    errors = [error for error in every if error is not None]
    if not errors:
        return None
    return PoseError(
        rotation=median(error.rotation for error in errors),
        translation=median(error.translation for error in errors),
    )


def _pose_error(model: SceneModel, view: ViewId, board: MeasuredBoard | None) -> PoseError | None:
    """Errors from the scene, or of lens and rig from a board that were kept."""
    if model.errors is None or view not in model.errors.rotation:
        return None
    rotation, translation = model.errors.rotation[view], model.errors.translation[view]
    if board is not None and view.camera in board.sure_lenses:
        lens, error = board.lenses[view.camera], board.lens_errors[view.camera]
        rotation = hypot(rotation, degrees(max(error.cx / lens.fx, error.cy / lens.fy)))
    if board is not None and board.sure_rig and view.camera in board.rig_errors:
        mounted = board.rig_errors[view.camera]
        rotation, translation = hypot(rotation, mounted.rotation), hypot(translation, mounted.translation)
    return PoseError(rotation=rotation, translation=translation)
