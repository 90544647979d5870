"""Recording of charts and shared points in a calibration."""

from collections.abc import Mapping, Sequence

import numpy as np

from calib.colour.measure import Charts
from calib.colour.white_balance import Balance, ColourObservations, estimate, folded
from calib.data.views import View
from calib.light.each_photograph import Development
from calib.light.falloff import DARKEST, light_left
from calib.light.tracks import point_observations
from calib.light.vignetting import Falloff
from calib.poses.sfm import SceneModel
from calib.sensor.metadata import CameraSensor
from imaging.arrays import Array
from imaging.colour.spaces import with_rgb
from imaging.sensor.mosaic import Matrix, as_matrix
from imaging.session.calibration import COLOUR, CalibrationRecord, CameraCalibration
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

CHART_RUNGS = frozenset({"chart_white", "chart_shading", "chart_matrix", "chart_matrix_each_camera"})


def balance(
    model: SceneModel,
    colours: Mapping[ViewId, Array],
    sensors: Mapping[str, CameraSensor],
    falloff: Falloff,
    anchors: Sequence[str],
) -> Balance:
    """The white balance between the placed RAW cameras.

    Args:
        model: Placed views, whose scene points compare the cameras.
        colours: `ViewSummary.colour` of each view [K, 3].
        sensors: Colour matrices by camera name; cameras without one are left out.
        falloff: Vignetting by camera name, divided out.
        anchors: Names of cameras whose white is from a chart.

    Returns:
        Sensitivities of the channels; empty where fewer than two cameras have a matrix, or it is not taken.
    """
    placed = sorted(model.lenses)
    matrices = {name: sensors[name].camera_from_rec709 for name in placed}
    known = [name for name in placed if matrices[name] is not None]
    if len(known) < 2:
        return Balance({}, {}, ())
    usable = {
        view: np.isfinite(colour).all(axis=1) & np.full(len(colour), view.camera in known)
        for view, colour in colours.items()
    }
    observations = point_observations(model, usable)
    camera = np.array(
        [known.index(view.camera) if view.camera in known else -1 for view in observations.views]
    )
    terms = np.array([falloff.vignetting[name] for name in known])[camera[observations.view]]
    fall = light_left(terms, observations.radius)
    light = observations.values({view: colour[:, :3] for view, colour in colours.items()})
    colour = light - np.log(np.maximum(fall, DARKEST))[:, None]
    coloured = ColourObservations(observations.point, camera[observations.view], colour)
    return estimate(coloured, known, [np.array(matrices[name])[:3] for name in known], anchors)


def with_balance(record: CalibrationRecord, balance_of: Balance) -> CalibrationRecord:
    """The record with the white balance between its cameras folded into matrices and gains."""
    cameras = tuple(_balanced(camera, balance_of) for camera in record.cameras)
    return record.model_copy(update={"cameras": cameras, "rungs": (*record.rungs, *balance_of.rungs)})


def _balanced(camera: CameraCalibration, balance_of: Balance) -> CameraCalibration:
    channels = balance_of.channels.get(camera.name)
    if channels is None or camera.camera_from_rec709 is None:
        return camera
    matrix, relative, gain = folded(np.array(camera.camera_from_rec709[:3]), channels)
    return camera.model_copy(
        update={
            "camera_from_rec709": as_matrix(with_rgb(camera.camera_from_rec709, matrix)),
            "white_balance": relative,
            "white_balance_error": balance_of.errors[camera.name],
            "gain": gain,
        }
    )


def with_development(
    record: CalibrationRecord, development: Development, views: Sequence[View]
) -> CalibrationRecord:
    """The record with the exposure and the white balance that each photograph was developed with."""
    scale = dict(record.exposure_scale)
    for view in views:
        for shot in view.shots:
            scale[shot.file] *= development.exposure.get(view.id, 1.0)
    placed = tuple(
        view.model_copy(
            update={
                "exposure": development.exposure.get(view.id, 1.0),
                "white_balance": development.white_balance.get(view.id, (1.0, 1.0, 1.0)),
                "exposure_asked": development.exposure_asked.get(view.id),
                "white_balance_asked": development.white_balance_asked.get(view.id),
            }
        )
        for view in record.views
    )
    rungs = (*record.rungs, *development.rungs)
    return record.model_copy(update={"views": placed, "exposure_scale": scale, "rungs": rungs})


def with_charts(record: CalibrationRecord, charts: Charts) -> CalibrationRecord:
    """The record with the evidence of charts, whose matrices its cameras have already."""
    if not charts.evidence:
        return record
    cameras = tuple(
        camera.model_copy(update={"chart": charts.evidence.get(camera.name)}) for camera in record.cameras
    )
    colour_rung = Rung(
        name=COLOUR,
        taken=True,
        reason=f"{len(charts.matrices)} of {len(record.cameras)} cameras by a colour chart that "
        f"{', '.join(sorted(charts.evidence))} saw",
    )
    rungs = tuple(colour_rung if rung.name == COLOUR else rung for rung in record.rungs)
    return record.model_copy(update={"cameras": cameras, "rungs": (*rungs, *charts.rungs)})


def charts_of(record: CalibrationRecord) -> Charts:
    """The charts of an earlier calibration, for one that measures other parts again."""
    evidence = {camera.name: camera.chart for camera in record.cameras if camera.chart is not None}
    if not evidence:
        return Charts()
    matrices: dict[str, Matrix] = {}
    for camera in record.cameras:
        if camera.camera_from_rec709 is not None:
            balance = np.array(camera.white_balance)[:, None]
            matrix = np.array(camera.camera_from_rec709)
            matrices[camera.name] = as_matrix(with_rgb(matrix, matrix[:3] / balance))
    return Charts(matrices, evidence, tuple(rung for rung in record.rungs if rung.name in CHART_RUNGS))


def rebalanced(record: CalibrationRecord) -> CalibrationRecord:
    """The record after its matrices were measured again, with the white balance it has folded into them.

    Cameras whose own chart was measured have their balance from it; the others' is relative to theirs.
    """
    anchors = [camera for camera in record.cameras if camera.chart is not None]
    known = np.array([camera.white_balance for camera in anchors]).reshape(-1, 3)
    middle = np.exp(np.log(known).mean(axis=0)) if anchors else np.ones(3)
    cameras = []
    for camera in record.cameras:
        relative = np.ones(3) if camera.chart is not None else np.array(camera.white_balance) / middle
        update: dict[str, object] = {"white_balance": tuple(relative.tolist())}
        if camera.camera_from_rec709 is not None:
            matrix = np.array(camera.camera_from_rec709)
            update["camera_from_rec709"] = as_matrix(with_rgb(matrix, relative[:, None] * matrix[:3]))
        cameras.append(camera.model_copy(update=update))
    return record.model_copy(update={"cameras": tuple(cameras)})
