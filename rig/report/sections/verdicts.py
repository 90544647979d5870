"""Verdict on a calibration: a line for the whole and one a camera, and outliers by name.

Each line names the number and the threshold that it is held against.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Literal, TypeVar, get_args

import numpy as np

from imaging.session.calibration import CalibrationRecord, CameraCalibration, ViewCalibration
from rig.report.charts.residuals import Residuals
from rig.terminal.text import counted, number, sentence

Grade = Literal["pass", "warn", "fail"]
Part = tuple[Grade, str]
"""Grade and words of one quantity."""
Key = TypeVar("Key")

GOOD_PX, POOR_PX = 0.8, 1.5
"""Reprojection error: below the first is good for photographs, above the second something is wrong."""
BOARD_PX, POOR_BOARD_PX = 0.5, 1.0
"""The same of corners of a board, which are found more sharply."""
FEW_POINTS = 30
"""A view that sees fewer scene points than this has a pose that should not be trusted."""
LENS_PX = 0.5
"""Mean standard error of a projection above which a lens adds visibly to the errors of a scene."""
FOCAL = 0.005
"""Relative error of a focal length above which the scene's shape suffers."""
GAIN = 0.05
"""Relative error of a gain above which the weights of a merge suffer."""
BEND = 0.05
"""Share of the signal that is missing at white above which a parabola hardly straightens it."""
OUTLIER = 2.5
"""A camera or view that misses by this many times the median of all is named."""
UNSURE = 5.0
"""A view whose rotation is this many times less sure than the median is named."""


@dataclass(frozen=True)
class Verdict:
    """One line that says whether to go on: the number, and what it is held against."""

    grade: Grade
    text: str


def verdicts(record: CalibrationRecord, residuals: Residuals) -> Iterable[Verdict]:
    """The line of the whole first, then one a camera."""
    if not record.views and record.unregistered:
        yield Verdict("warn", "No image has a pose: only what needs none was measured")
    error = record.reprojection_px
    if record.views and error is not None:
        yield Verdict(
            _grade(error, GOOD_PX, POOR_PX),
            f"Mean reprojection error {number(error)} px (good below {GOOD_PX}, doubtful above {POOR_PX} px)",
        )
    if record.board is not None:
        board = record.board
        yield Verdict(
            _grade(board.rms_px, BOARD_PX, POOR_BOARD_PX),
            f"Board: {counted(board.corners, 'corner')} in {counted(board.views, 'view')} fit to "
            f"{number(board.rms_px)} px rms (good below {BOARD_PX}, doubtful above {POOR_BOARD_PX} px)",
        )
    for camera in record.cameras:
        yield _of_camera(camera, record, residuals)


def _grade(value: float, good: float, poor: float) -> Grade:
    return "pass" if value < good else "warn" if value < poor else "fail"


def _of_camera(camera: CameraCalibration, record: CalibrationRecord, residuals: Residuals) -> Verdict:
    views = [view for view in record.views if view.camera == camera.name]
    total = len(views) + sum(view.camera == camera.name for view in record.unregistered)
    if record.views and total and not views:
        return Verdict("fail", f"{camera.name}: none of {counted(total, 'image')} has a pose")
    parts = [
        *_of_poses(views, total),
        *_of_residual(camera, residuals),
        *_of_lens(camera),
        *_of_gain(camera),
        *_of_linearity(camera),
        *_of_response(camera, looked_at=bool(total or not (record.views or record.unregistered))),
    ]
    if not parts:
        return Verdict("warn", f"{camera.name}: nothing was measured of it")
    worst = max((grade for grade, _ in parts), key=get_args(Grade).index)
    return Verdict(worst, f"{camera.name}: {'; '.join(words for _, words in parts)}")


def _of_poses(views: Sequence[ViewCalibration], total: int) -> Iterator[Part]:
    """The poses among the images of a camera, `total` in all."""
    if not views:
        return
    by_rig = sum(view.by_rig for view in views)
    weak = sum(view.points < FEW_POINTS for view in views) - by_rig
    confirmed = (
        f"{weak} of them from fewer than {FEW_POINTS} scene points"
        if weak
        else f"each from {min((v.points for v in views if not v.by_rig), default=0)} scene points or "
        f"more (at least {FEW_POINTS})"
    )
    if by_rig:
        others = "the others: " if by_rig < len(views) else ""
        confirmed = f"{by_rig} of them by the rig alone, {others}{confirmed}"
    doubtful = total > len(views) or weak or by_rig
    yield (
        "warn" if doubtful else "pass",
        f"{len(views)} of {counted(total, 'image')} with a pose, {confirmed}",
    )


def _of_residual(camera: CameraCalibration, residuals: Residuals) -> Iterator[Part]:
    if camera.name in residuals.cameras:
        rms = residuals.cameras[camera.name].rms
        yield _grade(rms, GOOD_PX, POOR_PX), f"residual {number(rms)} px rms (good below {GOOD_PX})"


def _of_lens(camera: CameraCalibration) -> Iterator[Part]:
    """The projection as a board determines it, else the focal length."""
    if camera.lens_error is not None and camera.lens_error.projection:
        places = camera.lens_error.projection_map()
        determined = np.isfinite(places)
        if not determined.any():
            yield "warn", "lens not determined by the board"
            return
        doubt, share = float(np.mean(places[determined])), 100 * determined.mean()
        where = "on average" if determined.all() else f"in {share:.0f} % of its image, not in the rest"
        yield (
            "warn" if doubt >= LENS_PX or not determined.all() else "pass",
            f"lens known to {number(doubt, 2)} px {where} (good below {LENS_PX})",
        )
    elif camera.lens_error is not None and camera.lens is not None:
        doubt = camera.lens_error.fx / camera.lens.fx
        known = f"known to {100 * doubt:.2g} % (good below {100 * FOCAL:g} %)"
        yield (
            "warn" if doubt >= FOCAL else "pass",
            f"the photographs do not determine the focal length, and the one that is used is {known}"
            if camera.lens_error.focal_untold
            else f"focal length {known}",
        )


def _of_gain(camera: CameraCalibration) -> Iterator[Part]:
    gains = [sensor.gain for sensor in camera.sensors if sensor.gain is not None]
    if gains:
        doubt = max(gain.sigma / gain.value for gain in gains if gain.value > 0)
        words = f"sensor gain known to {100 * doubt:.2g} % (good below {100 * GAIN:g} %)"
        yield "warn" if doubt >= GAIN else "pass", words


def _of_linearity(camera: CameraCalibration) -> Iterator[Part]:
    bends = [
        abs(sensor.nonlinearity.value)
        for sensor in camera.sensors
        if sensor.linear is False and sensor.nonlinearity is not None
    ]
    if bends:
        share = max(bends)
        words = f"RAW bends by {100 * share:.1f} % at white and is straightened (good below {100 * BEND:g} %)"
        yield "warn" if share >= BEND else "pass", words


def _of_response(camera: CameraCalibration, *, looked_at: bool) -> Iterator[Part]:
    """The response curve; one that is assumed counts only for a camera whose images were `looked_at`."""
    residual = camera.response.residual
    if residual is not None:
        agreement = f"{100 * math.expm1(residual):.2g} %"
        yield "pass", f"response measured, with overlapping exposures agreeing to {agreement}"
    elif camera.response.kind == "srgb" and looked_at:
        yield "warn", "its response is assumed, not measured"


def outliers(record: CalibrationRecord, residuals: Residuals) -> Iterable[str]:
    """A sentence for each camera or view that is much worse than the others."""
    yield from (sentence(words) for words in (record.board.outliers if record.board else ()))
    for name, value, typical in _beyond({k: camera.rms for k, camera in residuals.cameras.items()}, OUTLIER):
        yield (
            f"Camera {name} misses scene points by {value:.2f} px rms, the others by {typical:.2f} px: "
            "was it in focus, and fixed?"
        )
    for view, value, typical in _beyond(residuals.views, OUTLIER):
        yield f"View {view} misses by {value:.2f} px rms, the others by {typical:.2f} px."
    turns = {view.id: view.error.rotation for view in record.views if view.error is not None}
    for view, value, typical in _beyond(turns, UNSURE):
        yield (
            f"View {view} is turned by an angle known to {number(value, 2)}° only, "
            f"the others to {number(typical, 2)}°."
        )


def _beyond(values: Mapping[Key, float], factor: float) -> list[tuple[Key, float, float]]:
    """Keys that exceed `factor` times the median of all, with their value and the median, the worst first."""
    if len(values) < 3:
        return []
    typical = median(values.values())
    far = [(key, value, typical) for key, value in values.items() if value > factor * typical > 0]
    return sorted(far, key=lambda outlier: -outlier[1])[:12]
