"""Choice of a scene's coordinates: another session's, a survey's, those of its photographs, or its own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from calib.data.features import Features
from calib.data.views import View
from calib.poses.sfm import SceneModel
from calib.survey import gps, onto, placing
from calib.survey.control_points import Control
from calib.survey.gps import GpsFit
from calib.survey.marks import find_markers, joined
from calib.survey.onto import Target, place_onto
from calib.survey.placing import Expected, place_by_survey
from imaging.arrays import Bytes
from imaging.errors import CalibrationError
from imaging.progress import Progress
from imaging.session.coordinates import CoordinateSystem
from imaging.session.records import Rung
from imaging.session.session import Session
from imaging.session.view_id import ViewId

_KNOWN = 0.05
"""Relative difference allowed between a survey's lengths and those of a board or a ruler."""


def located(
    session: Session,
    views: Sequence[View],
    model: SceneModel,
    features: Mapping[ViewId, Features],
    control: Control | None,
    target: Target | None,
    read: Callable[[View], Bytes],
    progress: Progress,
) -> tuple[SceneModel, CoordinateSystem | None]:
    """Place the model in the best coordinates available, and return these.

    Args:
        session: Session of the views.
        views: Views of the scene, with the photographs that may state GPS positions.
        model: Scene model in coordinates of its own.
        features: Features of the views, as the model was made from them.
        control: Surveyed points with their marks, or None.
        target: Session whose coordinates are wanted, or None.
        read: Function that gives the picture of a view, uint8 [H, W], in which markers are detected.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The placed model, with a rung that gives the reason where other coordinates were to be had; and its
        coordinates, None if they are its own.

    Raises:
        InputError: A file that markers or the other session's features are found in is missing or damaged.
    """
    if target is not None:
        try:
            return place_onto(model, features, target, progress)
        except CalibrationError as error:
            rung = Rung(name=onto.NAME, taken=False, reason=str(error))
            return replace(model, rungs=(*model.rungs, rung)), None
    positions = gps.positions_of(session, views)
    by_gps = gps.fit_gps(model, positions) if positions else None
    if control is not None:
        marks = control.marks
        if control.dictionary is not None:
            detected = find_markers(control.dictionary, control.survey.points, views, read, progress)
            marks = joined(marks, detected)
        progress("placing by surveyed points", 0, 1)
        sizes = {view.camera.name: (view.shots[0].width, view.shots[0].height) for view in views}
        try:
            return place_by_survey(model, control.survey, marks, sizes, _expected(model, by_gps))
        except CalibrationError as error:
            rung = Rung(name=placing.NAME, taken=False, reason=str(error))
            return replace(model, rungs=(*model.rungs, rung)), None
    if by_gps is None:
        return model, None
    model, coordinates, rung = gps.place_by_gps(model, by_gps)
    return replace(model, rungs=(*model.rungs, rung)), coordinates


def _expected(model: SceneModel, by_gps: GpsFit | str | None) -> Expected | None:
    """Return the scale expected beside a survey."""
    if model.metric:
        return Expected(1.0, "the board or the positions of the rig's cameras", _KNOWN)
    if isinstance(by_gps, GpsFit) and by_gps.sure and by_gps.errors[0] is not None:
        tolerance = max(4 * by_gps.errors[0], _KNOWN)
        return Expected(float(by_gps.similarity.scale), "the photographs' GPS positions", tolerance)
    return None
