"""The one factor that shows a session as middle grey: of plates, renders, hand-overs and the viewer."""

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from imaging.arrays import Array32, Floats
from imaging.colour.spaces import XYZ_FROM_REC709
from imaging.errors import InputError
from imaging.files.photo import is_photo
from imaging.merge.linear_frame import LinearFrame, read_linear
from imaging.plates.bracket_exposures import exposure_scales, response_of
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord
from imaging.session.falloff import falloff
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId

MIDDLE_GREY = 0.18
MOST_VIEWS = 8
"""Largest number of views from which the light of a session is measured."""
GREEN = 1
LIKE = 0.25
"""Stops by which a new measurement may differ from the last without a change: plates that exist still fit."""
Scaled = Sequence[tuple[ShotRecord, float]]
"""Shots, each with its exposure scale."""


def exposure_factor(
    session: Session, calibration: CalibrationRecord | None, progress: Progress = unreported
) -> float:
    """Factor on light that shows a session as middle grey: that of its calibration, else measured."""
    if calibration is not None and calibration.exposure_factor is not None:
        return calibration.exposure_factor
    return measured_factor(session, calibration, progress)


def lasting_factor(session: Session, calibration: CalibrationRecord, before: float | None) -> float | None:
    """Factor for the record of a new calibration: that of the one before, where it still fits.

    None of a session without any shot of a scene.
    """
    if not session.shots("scene"):
        return None
    new = measured_factor(session, calibration)
    return before if before is not None and abs(np.log2(new / before)) <= LIKE else new


def measured_factor(
    session: Session, calibration: CalibrationRecord | None, progress: Progress = unreported
) -> float:
    """Factor that shows the median of the light as middle grey, to a tenth of a stop; 1 without light.

    Of single developed photographs it is the one that they were shot at, by which they look as they are. The
    middle exposure of some views, evenly chosen, is read, or a shorter one where half of it is saturated:
    gain and vignetting are divided out, green of a mosaic is taken for its light, and what is saturated
    counts as brighter than the median. InputError for a missing or damaged file.
    """
    views = _exposed(session, calibration)
    if views and all(len(shots) == 1 and is_photo(session.file(shots[0][0])) for shots in views.values()):
        return float(np.exp(np.median(np.log([shots[0][1] for shots in views.values()]))))
    every = list(views)
    chosen = sorted({round(place) for place in np.linspace(0, len(every) - 1, MOST_VIEWS)}) if every else []
    lights: list[Array32] = []
    for done, place in enumerate(chosen):
        progress("finding the exposure", done, len(chosen))
        lights.append(_light(session, every[place], views[every[place]], calibration))
    progress("finding the exposure", len(chosen), len(chosen))
    light = np.concatenate([np.zeros(0, np.float32), *lights])
    light = light[light > 0]
    middle = float(np.median(light)) if light.size else 0.0
    return float(2.0 ** np.round(np.log2(MIDDLE_GREY / middle), 1)) if 0 < middle < np.inf else 1.0


def _exposed(session: Session, calibration: CalibrationRecord | None) -> Mapping[ViewId, Scaled]:
    """Brackets of the scene with the exposure scale of each shot."""
    scales = None if calibration is None else calibration.exposure_scale
    exposed = {}
    for view, shots in brackets(session.shots("scene")).items():
        with suppress(InputError):  # what has no exposure tells no light, and is refused where it is merged
            exposed[view] = list(zip(shots, exposure_scales(session, shots, scales), strict=True))
    return exposed


def _light(session: Session, view: ViewId, shots: Scaled, calibration: CalibrationRecord | None) -> Array32:
    """Light of a view [N], infinite where it is saturated."""
    camera = None if calibration is None else calibration.camera(view.camera)
    kind, sensors = session.camera(view.camera).kind, () if camera is None else camera.sensors
    response = response_of(session, view.camera, calibration)
    ordered = sorted(shots, key=lambda shot: shot[1])
    for shot, k in reversed(ordered[: len(ordered) // 2 + 1]):
        frame = read_linear(session.file(shot), kind, k, response, sensors)
        if np.mean(frame.saturated) < 0.5:
            break
    signal = np.where(frame.saturated, np.float32(np.inf), frame.signal / np.float32(k))
    if camera is not None:
        fall = falloff(camera, *signal.shape[:2])
        signal = signal / (fall if signal.ndim == 2 else fall[..., None])
    return _grey(frame, signal)


def _grey(frame: LinearFrame, signal: Floats) -> Array32:
    """Return an estimate of the luminance of pixels that count."""
    if signal.ndim == 3:
        return np.asarray((signal @ XYZ_FROM_REC709[1])[frame.valid.all(-1)], np.float32)
    valid = frame.valid
    if frame.cfa is not None and (green := frame.cfa.channels(*signal.shape) == GREEN).any():
        valid = valid & green
    return np.asarray(signal[valid], np.float32)
