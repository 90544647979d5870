"""Calibration of a session from its own pictures, in four steps: evidence, poses, light, record."""

from collections.abc import Iterator
from os import PathLike

from calib.assemble import assemble, with_part
from calib.colour.colour_record import rebalanced
from calib.data.unfinished import Unfinished
from calib.evidence import Evidence, gather, with_board
from calib.exports import training_pictures
from calib.exports.output import write_calibration
from calib.luminance.measure import RUNG, scaled
from calib.measures import MEASURES, require_usable
from calib.place_views import Placement, cache_key, place_views, require_sizes
from calib.request import CalibrationRequest
from calib.scene_light import SceneLight, measure_scene_light
from calib.survey import onto, placing
from calib.turntable.background import without_background
from calib.view_images import processes
from imaging.arguments import checked
from imaging.arrays import Bytes
from imaging.compute.processes import in_processes
from imaging.compute.threads import one_thread_a_product
from imaging.errors import CalibrationError, PartialError
from imaging.files import store
from imaging.plates.middle_grey import lasting_factor
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord
from imaging.session.lock import sole_calibrator
from imaging.session.session import Session
from imaging.session.view_id import ViewId

_DEFAULTS = CalibrationRequest()


@one_thread_a_product()
@checked
def calibrate(
    session: str | PathLike[str],
    request: CalibrationRequest = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    **options: object,
) -> CalibrationRecord:
    """Calibrate a session and write its `calibration/` folder, which is replaced as a whole or not at all.

    Args:
        session: Session, or its folder.
        request: Options.
        on_progress: Callback for the current step, the steps done, and all of them.
        options: Options by name, in place of those of `request`.

    Returns:
        The record that was written; views without a pose are listed in it.

    Raises:
        CalibrationError: No view can be placed and nothing else was measured, or an earlier calibration has
            poses, which then stays.
        PartialError: The board, the poses or the readings had to be left out of the record.
        InputError: The session is damaged, or being calibrated, or an option cannot be used.
        StorageError: The disk refuses.
    """
    opened = Session.open(session)
    store.require_writable(opened.folder / "calibration")
    require_usable(request)
    with sole_calibrator(opened.folder):
        return _calibrated(opened, request, on_progress)


def _calibrated(opened: Session, request: CalibrationRequest, on_progress: Progress) -> CalibrationRecord:
    """Run `calibrate` while no other process calibrates the session."""
    # 1. Evidence: what needs no poses, measured or of the earlier calibration, which is opened here alone.
    evidence = gather(opened, request, on_progress)
    if not MEASURES[request.only].poses:
        return _calibrate_part(evidence, request)
    evidence, refused = with_board(evidence, request.board, on_progress)
    if not evidence.views:
        if evidence.board is None and not evidence.has_sensor_frames:
            raise CalibrationError(refused)
        return _complete(_write_without_poses(evidence, on_progress), evidence, refused)
    require_sizes(evidence)
    evidence, masks = without_background(evidence, on_progress)

    # 2. Poses: features and matches stay in the session until they are done.
    unfinished = Unfinished(opened.folder, cache_key(evidence))
    try:
        placement = place_views(evidence, unfinished, request.keep_doubtful, on_progress)
    except CalibrationError as error:
        unfinished.finish()
        cause = f"{str(error)[0].lower()}{str(error)[1:]}"
        if not evidence.measured or (evidence.earlier is not None and evidence.earlier.views):
            raise CalibrationError(f"{opened.folder}: {cause}") from error
        _write_without_poses(evidence, on_progress)
        also = f" The board was left out: {refused}" if refused else ""
        raise PartialError(
            f"{opened.folder}: {evidence.measured}, but no view has a pose: {cause}{also}"
        ) from error

    # 3. Light: falloff, sensitivities, white balance, and the settings of photographs, by scene points.
    light = measure_scene_light(evidence, placement, on_progress)

    # 4. Record: all of it, with the scale of the light, and a picture of each view.
    record = _with_scales(assemble(evidence, placement, light), evidence)
    record = record.model_copy(update={"rungs": (*record.rungs, *masks)})
    shown = _pictures(evidence, record, placement, light)
    write_calibration(opened, record, shown, placement.model, on_progress)
    unfinished.finish()
    return _complete(record, evidence, refused)


def _calibrate_part(evidence: Evidence, request: CalibrationRequest) -> CalibrationRecord:
    """Write the earlier calibration with one part of it measured again; poses stay."""
    record, folder = with_part(evidence, MEASURES[request.only]), evidence.session.folder
    if request.only == "colour" and evidence.earlier is not None:
        record = rebalanced(record)
    record = _with_scales(record, evidence)
    missing = _missing_scale(record, evidence)
    if missing and request.only == "luminance":
        raise CalibrationError(f"{folder}: {missing}.")
    store.write_json(folder / "calibration" / "calibration.json", record.model_dump(mode="json"))
    if missing:
        raise PartialError(f"{folder}: {request.only} is calibrated, and the light has no scale: {missing}.")
    return record


def _write_without_poses(evidence: Evidence, progress: Progress) -> CalibrationRecord:
    record = _with_scales(assemble(evidence), evidence)
    write_calibration(evidence.session, record, (), None, progress)
    return record


def _with_scales(record: CalibrationRecord, evidence: Evidence) -> CalibrationRecord:
    """Add the scale of the light, by readings that are given, else by those of the earlier calibration, and
    the factor that shows it as middle grey.
    """
    session, earlier = evidence.session, evidence.earlier
    factor = lasting_factor(session, record, None if earlier is None else earlier.exposure_factor)
    record = record.model_copy(update={"exposure_factor": factor})
    before = None if earlier is None or evidence.readings is not None else earlier.luminance
    return scaled(session, record, evidence.readings, before)


def _pictures(
    evidence: Evidence, record: CalibrationRecord, placement: Placement, light: SceneLight
) -> Iterator[tuple[ViewId, Bytes]]:
    """Each view in colour, at the size at which its features were found, all of one exposure."""
    factor = training_pictures.exposure(light.brightness)
    drawn = in_processes(
        processes(evidence.views),
        training_pictures.picture,
        [
            (
                evidence.session,
                view,
                {shot.file: evidence.light.scale[shot.file] for shot in view.shots},
                evidence.light.responses[view.camera.name],
                record.camera(view.camera.name).camera_from_rec709,
                (placement.summaries[view.id].width, placement.summaries[view.id].height),
                factor,
            )
            for view in evidence.views
        ],
    )
    yield from zip((view.id for view in evidence.views), drawn, strict=True)


def _complete(record: CalibrationRecord, evidence: Evidence, board_refused: str) -> CalibrationRecord:
    """Return the record that was written; PartialError if something that was given is not in it."""
    folder = evidence.session.folder
    if board_refused:
        raise PartialError(f"{folder}: the board was left out, and the rest is calibrated: {board_refused}")
    if missing := _missing_scale(record, evidence):
        raise PartialError(f"{folder}: everything is calibrated except the scale of light: {missing}.")
    if missing := _missing_coordinates(record, evidence):
        raise PartialError(f"{folder}: everything is calibrated, but in arbitrary coordinates: {missing}.")
    return record


def _missing_coordinates(record: CalibrationRecord, evidence: Evidence) -> str:
    """Return why the scene is not where it was to be placed; empty if it is, or if nothing was asked for."""
    asked = placing.NAME if evidence.control is not None else onto.NAME if evidence.target is not None else ""
    if not asked or not record.views or any(rung.name == asked and rung.taken for rung in record.rungs):
        return ""
    return next(rung.reason for rung in record.rungs if rung.name == asked)


def _missing_scale(record: CalibrationRecord, evidence: Evidence) -> str:
    """Return why readings that were given gave no scale; empty if they did, or if none were given."""
    if not evidence.readings or record.luminance is not None:
        return ""
    return next(rung.reason for rung in record.rungs if rung.name == RUNG)
