"""The one factor by which all merged pictures of a session open exposed to middle grey."""

from collections.abc import Mapping, Sequence

import numpy as np

from calib.luminance.area import LUMINANCE
from imaging.arrays import Array32, Floats
from imaging.merge.linear_frame import LinearFrame, read_linear
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response
from imaging.session.falloff import falloff
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId

MIDDLE_GREY = 0.18
MOST_VIEWS = 8
"""Largest number of views from which the light of a session is measured."""
GREEN = 1


def exposure_factor(
    session: Session,
    views: Mapping[ViewId, Sequence[tuple[ShotRecord, float, Response]]],
    calibration: CalibrationRecord | None,
    progress: Progress,
) -> float:
    """Factor on light that shows the median of a session as middle grey, to the nearest stop; 1 without
    light. A power of two changes no digit of the light, and another calibration rarely changes it.

    views: every bracket of the scene, each shot with its exposure scale and response. The middle exposure of
    some views, evenly chosen, is read, or a shorter one where half of it is saturated: gain and
    vignetting are divided out, green of a mosaic is taken for its light, and what is saturated counts as
    brighter than the median. InputError for a missing or damaged file.
    """
    every = list(views)
    chosen = sorted({round(place) for place in np.linspace(0, len(every) - 1, MOST_VIEWS)}) if every else []
    lights: list[Array32] = []
    for done, place in enumerate(chosen):
        progress("finding the exposure", done, len(chosen))
        view = every[place]
        camera = None if calibration is None else calibration.camera(view.camera)
        lights.append(_light(session, view, views[view], camera))
    progress("finding the exposure", len(chosen), len(chosen))
    light = np.concatenate([np.zeros(0, np.float32), *lights])
    middle = float(np.median(light)) if light.size else 0.0
    return float(2.0 ** round(np.log2(MIDDLE_GREY / middle))) if 0 < middle < np.inf else 1.0


def _light(
    session: Session,
    view: ViewId,
    shots: Sequence[tuple[ShotRecord, float, Response]],
    camera: CameraCalibration | None,
) -> Array32:
    """Light of a view [N], infinite where it is saturated."""
    kind, sensors = session.camera(view.camera).kind, () if camera is None else camera.sensors
    ordered = sorted(shots, key=lambda shot: shot[1])
    for shot, k, response in reversed(ordered[: len(ordered) // 2 + 1]):
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
        return np.asarray((signal @ LUMINANCE)[frame.valid.all(-1)], np.float32)
    valid = frame.valid
    if frame.cfa is not None and (green := frame.cfa.channels(*signal.shape) == GREEN).any():
        valid = valid & green
    return np.asarray(signal[valid], np.float32)
