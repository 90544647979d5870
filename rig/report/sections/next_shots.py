"""Advice for the next shots: sentences that follow from gaps and errors of a calibration."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from imaging.and_list import and_more
from imaging.session.calibration import MOTION, CalibrationRecord, CameraCalibration
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from rig.report.sections.verdicts import FEW_POINTS, LENS_PX
from rig.terminal.text import counted, number

FEW_FRAMES = 15
"""Frames of a board below which a lens is not known over the whole image."""
LOPSIDED = 3.0
"""An image edge this many times less sure than the middle was not reached by the board."""
MOST_NAMES = 6


def next_shots(session: Session, record: CalibrationRecord) -> Iterable[str]:
    """Yield what is missing first, then what is weak; nothing where all is well."""
    yield from _poses(record, session.photograph_names())
    yield from _sensors(session, record)
    yield from _responses(session, record)
    yield from _board(session, record)


def _how(session: Session, option: str) -> str:
    """The command that takes such shots, where we drive the cameras."""
    return "" if session.record.origin == "import" else f" and run rig capture {option}"


def _named(names: Sequence[str]) -> str:
    return and_more(names, MOST_NAMES)


def _poses(record: CalibrationRecord, photographs: Mapping[ViewId, str]) -> Iterable[str]:
    """Sentences on views without a pose or with a weak one; photographs: their names, of an import."""

    def named(views: Sequence[ViewId]) -> str:
        return _named([photographs.get(view, str(view)) for view in views])

    posed = {view.camera for view in record.views}
    lost = {view.camera for view in record.unregistered} - posed
    untied = [rung.reason for rung in record.rungs if rung.name == MOTION and not rung.taken]
    yield from (f"{reason[0].upper()}{reason[1:]}." for reason in untied)
    if record.views and lost:
        yield (
            f"{_named(sorted(lost))} has no pose at all: point it so that it shows what the other cameras "
            "show, with half of the image in common."
        )
    stray = [view for view in record.unregistered if view.camera not in lost]
    if record.views and stray:
        yield f"{named(stray)} got no pose: take more pictures between these and their neighbours."
    if not record.views and record.unregistered:
        yield (
            "No image has a pose: walk around a textured scene and take 20 views or more, each showing two "
            "thirds of the one before."
        )
    yield from (f"{doubt[0].upper()}{doubt[1:]}." for doubt in record.doubts)
    by_rig = [view.id for view in record.views if view.by_rig]
    refuted = [view for view in by_rig if view in record.contradicted]
    if refuted:
        yield (
            f"{named(refuted)} contradicts other views about where it stands, as where parts of a scene "
            "look alike: its pose is the rig's, and no reconstruction looks at it."
        )
    guessed = [view for view in by_rig if view not in record.contradicted]
    if guessed:
        yield (
            f"Nothing in {named(guessed)} was recognised: its pose is the rig's, and no reconstruction "
            "looks at it; see whether it is black, blurred or bare, and take the frame again."
        )
    weak = [view.id for view in record.views if view.points < FEW_POINTS and not view.by_rig]
    if weak:
        yield (
            f"{named(weak)} sees fewer than {FEW_POINTS} scene points: take pictures nearby that show more "
            "texture."
        )


def _sensors(session: Session, record: CalibrationRecord) -> Iterable[str]:
    raw = {camera.name for camera in session.record.cameras if camera.kind == "raw"}
    cameras = [camera for camera in record.cameras if camera.name in raw]
    if not cameras:
        return
    if not session.shots("dark"):
        yield (
            "There are no darks: black without light, dark current, DSNU and hot photosites are not "
            f"determined. Cover the lenses{_how(session, '--darks')}."
        )
    if not session.shots("flat"):
        yield (
            "There are no flats: PRNU and dead photosites are not determined, and vignetting rests on the "
            f"scene. Show an evenly lit surface{_how(session, '--flats')}."
        )
    blind = [camera.name for camera in cameras if not any(sensor.gain for sensor in camera.sensors)]
    if blind:
        yield (
            f"The gain of {_named(blind)} is not determined: take two exposures or more of a still scene "
            "that overlap, or flats."
        )
    ends = [c.name for c in cameras if c.sensors and not any(sensor.ceiling for sensor in c.sensors)]
    if ends:
        yield (
            f"Where {_named(ends)} saturates is not determined: take flats up to the ceiling, or brackets of "
            "a larger lamp."
        )


def _responses(session: Session, record: CalibrationRecord) -> Iterable[str]:
    shown = {shot.camera for shot in session.shots("scene")}
    assumed = [
        camera.name
        for camera in record.cameras
        if camera.name in shown and camera.response.kind == "srgb" and camera.response.residual is None
    ]
    if assumed:
        yield (
            f"The response of {_named(assumed)} is assumed: take three exposures of a view, one to three "
            "stops apart, to measure it."
        )
    narrow = [
        camera.name
        for camera in record.cameras
        if camera.response.kind == "curve" and camera.response.valid[1] - camera.response.valid[0] < 0.8
    ]
    if narrow:
        low, high = next(c.response.valid for c in record.cameras if c.name == narrow[0])
        yield (
            f"The response of {_named(narrow)} is measured between codes {255 * low:.0f} and "
            f"{255 * high:.0f} of 255 only: add exposures that reach the others."
        )


def _board(session: Session, record: CalibrationRecord) -> Iterable[str]:
    rigged = sum(camera.rig is not None for camera in session.record.cameras) > 1
    if record.board is None:
        if record.views and record.unit != "m":
            yield (
                "Lengths have no unit" + (" and the rig's own geometry rests on the scene" if rigged else "")
                + f": show a calibration board{_how(session, '--board')}, or survey points of the scene."
            )  # fmt: skip
        return
    if record.board.frames < FEW_FRAMES:
        yield (
            f"The board was seen in {counted(record.board.frames, 'frame')}: take {FEW_FRAMES} or more, near "
            "and far, tilted to all sides."
        )
    edges = [words for camera in record.cameras if (words := _edges(camera)) is not None]
    if edges:
        yield f"The board did not reach the corners of {_named(edges)}: hold it there too."
    if any(rung.name == "board_rig" and not rung.taken for rung in record.rungs):
        yield (
            "The board does not determine the rig well enough: hold it where several cameras see it "
            "at once, nearer, and in more frames."
        )


def _edges(camera: CameraCalibration) -> str | None:
    """The camera and the worst of its corners, where these are much less sure than the middle."""
    error = camera.lens_error
    if error is None or not error.projection:
        return None
    grid = error.projection_map()
    rows, columns = grid.shape
    middle = float(np.median(grid[rows // 4 : rows - rows // 4, columns // 4 : columns - columns // 4]))
    corners = {
        "upper left": grid[0, 0],
        "upper right": grid[0, -1],
        "lower left": grid[-1, 0],
        "lower right": grid[-1, -1],
    }
    where, worst = max(corners.items(), key=lambda corner: corner[1])
    if worst <= max(LOPSIDED * middle, LENS_PX):
        return None
    certainty = f"known to {number(float(worst), 2)} px" if np.isfinite(worst) else "not known"
    return f"{camera.name} ({where} {certainty}, the middle to {number(middle, 2)} px)"
