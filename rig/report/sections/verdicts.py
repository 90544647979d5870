"""Verdict on a calibration: a line for the whole and one a camera, and outliers by name.

Each line names the number and the threshold that it is held against.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Literal, TypeVar

import numpy as np

from imaging.session.calibration import CalibrationRecord, CameraCalibration
from rig.report.charts.residuals import Residuals
from rig.terminal.text import counted, number, sentence

Grade = Literal["pass", "warn", "fail"]
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
    grades: list[Grade] = ["pass"]
    words = []
    views = [view for view in record.views if view.camera == camera.name]
    missed = sum(view.camera == camera.name for view in record.unregistered)
    total = len(views) + missed
    if record.views and total and not views:
        return Verdict("fail", f"{camera.name}: none of {counted(total, 'image')} has a pose")
    if views:
        by_rig = sum(view.by_rig for view in views)
        weak = sum(view.points < FEW_POINTS for view in views) - by_rig
        grades += ["warn"] * bool(missed or weak or by_rig)
        sight = (
            f"{weak} of them from fewer than {FEW_POINTS} scene points"
            if weak
            else f"each from {min((v.points for v in views if not v.by_rig), default=0)} scene points or "
            f"more (at least {FEW_POINTS})"
        )
        if by_rig:
            sight = (
                f"{by_rig} of them by the rig alone, {'the others: ' if by_rig < len(views) else ''}{sight}"
            )
        words += [f"{len(views)} of {counted(total, 'image')} with a pose, {sight}"]
    if camera.name in residuals.cameras:
        rms = residuals.cameras[camera.name].rms
        grades.append(_grade(rms, GOOD_PX, POOR_PX))
        words.append(f"residual {number(rms)} px rms (good below {GOOD_PX})")
    if camera.lens_error is not None and camera.lens_error.projection:
        places = camera.lens_error.projection_map()
        determined = np.isfinite(places)
        doubt = float(np.mean(places[determined])) if determined.any() else math.inf
        grades += ["warn"] * (doubt >= LENS_PX or not determined.all())
        where = (
            "on average"
            if determined.all()
            else f"in {100 * determined.mean():.0f} % of its image, not in the rest"
        )
        words.append(
            f"lens known to {number(doubt, 2)} px {where} (good below {LENS_PX})"
            if determined.any()
            else "lens not determined by the board"
        )
    elif camera.lens_error is not None and camera.lens is not None:
        doubt = camera.lens_error.fx / camera.lens.fx
        grades += ["warn"] * (doubt >= FOCAL)
        words.append(
            "the photographs do not determine the focal length, and the one that is used is known to "
            f"{100 * doubt:.2g} % (good below {100 * FOCAL:g} %)"
            if camera.lens_error.focal_untold
            else f"focal length known to {100 * doubt:.2g} % (good below {100 * FOCAL:g} %)"
        )
    gains = [sensor.gain for sensor in camera.sensors if sensor.gain is not None]
    if gains:
        doubt = max(gain.sigma / gain.value for gain in gains if gain.value > 0)
        grades += ["warn"] * (doubt >= GAIN)
        words.append(f"sensor gain known to {100 * doubt:.2g} % (good below {100 * GAIN:g} %)")
    bent = [sensor for sensor in camera.sensors if sensor.linear is False and sensor.nonlinearity is not None]
    if bent:
        share = max(abs(sensor.nonlinearity.value) for sensor in bent if sensor.nonlinearity is not None)
        grades += ["warn"] * (share >= BEND)
        words.append(
            f"RAW bends by {100 * share:.1f} % at white and is straightened (good below {100 * BEND:g} %)"
        )
    if camera.response.residual is not None:
        words.append(
            "response measured, with overlapping exposures agreeing to "
            f"{100 * math.expm1(camera.response.residual):.2g} %"
        )
    looked_at = total or not (record.views or record.unregistered)
    if camera.response.kind == "srgb" and camera.response.residual is None and looked_at:
        grades.append("warn")
        words.append("its response is assumed, not measured")
    if not words:
        return Verdict("warn", f"{camera.name}: nothing was measured of it")
    worst: Grade = "fail" if "fail" in grades else "warn" if "warn" in grades else "pass"
    return Verdict(worst, f"{camera.name}: {'; '.join(words)}")


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
