"""The light of a small area of a view: its luminance in the unit of the calibration, and how sure that is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array
from imaging.colour.spaces import XYZ_FROM_REC709, rec709_from_camera
from imaging.errors import CalibrationError
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.curve_error import with_curve_error
from imaging.merge.linear_frame import LinearFrame, read_linear
from imaging.plates.merged_view import white_balance
from imaging.session.calibration import CalibrationRecord, CameraCalibration
from imaging.session.falloff import falloff
from imaging.session.luminance import Area, LuminanceReading
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId

LUMINANCE = XYZ_FROM_REC709[1]
"""Luminance weights of linear Rec.709 (ITU-R BT.709)."""
FEWEST = 9
"""Pixels of each colour in a quarter of an area."""
MOST_LOST = 0.01
"""Share of an area that may be saturated or black."""
LEAST_SNR = 10.0
MOST_UNEVEN = 0.2
"""Relative standard error of the mean of an area whose parts differ."""
EXPOSURE_ERROR = 0.04
"""Relative error of labels: that of shutters, where overlapping exposures give no measurement."""


@dataclass(frozen=True)
class AreaLight:
    """light: mean luminance in the unit of the calibration; error: its standard error, relative; radius: of
    the centre of the area, 1 at the corner of the image."""

    light: float
    error: float
    radius: float


def area_light(session: Session, record: CalibrationRecord, view: ViewId, area: Area) -> AreaLight:
    """Merge an area of a view and measure its luminance.

    Gain, vignetting and white balance of the picture are divided out, as `rig merge` does it. The error is
    of the noise, of quarters that differ, of the exposures and of a measured response.

    Args:
        session: Session of the view.
        record: Its calibration.
        view: View of the scene.
        area: Left, top, width and height, px of the file.

    Returns:
        Luminance in the unit of the calibration, its relative error, and the radius of the area's centre.

    Raises:
        CalibrationError: The area is not in the picture, too small, uneven, saturated or dark; the session
            has no such view; or the exposure of a shot or the colour of the camera is not known.
        InputError: A file is missing or damaged.
    """
    shots, place = _shots(session, view, area), f"{view}:{','.join(map(str, area))}"
    camera = record.camera(view.camera)
    weights = _weights(camera, session.camera(view.camera).kind == "raw", view)
    left, top, width, height = area
    window = (slice(top, top + height), slice(left, left + width))
    frames, channels, sides = [], None, (0, 0)
    for shot in shots:
        kind = session.camera(view.camera).kind
        k = record.exposure_scale.get(shot.file)
        if k is None:
            raise CalibrationError(
                f"the exposure of {shot.file} is not known: run `rig calibrate` without --only."
            )
        frame = read_linear(session.file(shot), kind, k, camera.response, camera.sensors)
        if shot is shots[0]:
            sides = frame.signal.shape[1], frame.signal.shape[0]
            channels = None if frame.cfa is None else frame.cfa.channels(*frame.signal.shape)[window]
        frames.append(_cut(frame, window))
    fall = falloff(camera, sides[1], sides[0])[window].astype(np.float64)
    white = white_balance(session, view, record)
    developed = fall if frames[0].signal.ndim == 2 else fall[..., None] * np.array(white or (1.0, 1.0, 1.0))
    light, error = _luminance(frames, channels, camera, weights, developed, place)
    centre = np.array((left + width / 2, top + height / 2)) - np.array(sides) / 2
    radius = float(np.hypot(*centre) / np.hypot(*(np.array(sides) / 2)))
    return AreaLight(light, float(np.hypot(error, _exposure_error(record))), radius)


def require_places(session: Session, readings: Sequence[LuminanceReading]) -> None:
    """CalibrationError if a reading is of a view or an area that the session does not have."""
    for reading in readings:
        if reading.view is not None and reading.area is not None:
            _shots(session, reading.view, reading.area)


def _shots(session: Session, view: ViewId, area: Area) -> list[ShotRecord]:
    """The bracket of a view that shows an area."""
    shots = brackets(session.shots("scene")).get(view)
    if not shots:
        raise CalibrationError(
            f"{session.folder} has no shot of the scene of {view}: name a view as FRAME/CAMERA, as `rig "
            "check` does."
        )
    width, height = shots[0].width, shots[0].height
    if area[0] + area[2] > width or area[1] + area[3] > height:
        raise CalibrationError(
            f"{view}:{','.join(map(str, area))} reaches beyond the picture, which has {width}x{height} "
            "pixels: give left, top, width and height in pixels of the file."
        )
    return shots


def _weights(camera: CameraCalibration, raw: bool, view: ViewId) -> Array:
    """Return what R, G and B of the camera count in the luminance, float64 [3]; W is left out."""
    if camera.camera_from_rec709 is not None:
        return np.asarray(LUMINANCE @ rec709_from_camera(camera.camera_from_rec709[:3]))
    if raw:
        raise CalibrationError(
            f"the colour of camera {view.camera} is not known, so that its light has no luminance: show it a "
            "colour chart and add --chart, or read something in a picture of a camera whose colour is known."
        )
    return np.asarray(LUMINANCE)


def _cut(frame: LinearFrame, window: tuple[slice, slice]) -> LinearFrame:
    """A window of a frame, without its mosaic's phase."""
    arrays = {name: getattr(frame, name)[window] for name in ("signal", "saturated", "dark", "valid")}
    return replace(frame, **arrays, cfa=None)


def _luminance(
    frames: Sequence[LinearFrame],
    channels: npt.NDArray[np.integer] | None,
    camera: CameraCalibration,
    weights: Array,
    developed: Array,
    place: str,
) -> tuple[float, float]:
    """The luminance of an area and its relative error; developed: their values of light 1."""
    merged = merge_bracket(frames)
    _require_light(merged, place)
    total = with_curve_error(merged, frames, camera.response)
    light = merged.radiance / developed
    sigmas = [None if sigma is None else sigma / developed for sigma in (merged.sigma, total.sigma)]
    known = merged.valid
    height, width = light.shape[:2]
    quarter = 2 * (np.arange(height) >= height / 2)[:, None] + (np.arange(width) >= width / 2)[None]
    means, variances = np.zeros((4, 3)), np.zeros((4, 3))
    noise, curve = np.zeros(3), np.zeros(3)
    for channel in range(3):
        valid = known & (channels == channel) if channels is not None else known[..., channel]
        plane = slice(None) if channels is not None else channel
        values = light[..., plane]
        for part in range(4):
            sites = valid & (quarter == part)
            if sites.sum() < FEWEST:
                raise CalibrationError(
                    f"{place} is too small: mark an even area of {4 * FEWEST} pixels or more of every "
                    "colour, such as 24x24."
                )
            chosen = values[sites].astype(np.float64)
            means[part, channel] = chosen.mean()
            variances[part, channel] = chosen.var(ddof=1) / len(chosen)
        if sigmas[0] is not None and sigmas[1] is not None:
            alone, both = (one[..., plane][valid].astype(np.float64) for one in sigmas if one is not None)
            noise[channel] = np.sqrt((alone**2).sum()) / valid.sum()
            curve[channel] = np.sqrt(np.maximum(both**2 - alone**2, 0.0)).mean()
    parts = means @ weights
    luminance = float(parts.mean())
    if not luminance > LEAST_SNR * float(np.sqrt((noise**2) @ weights**2)):
        raise CalibrationError(
            f"{place} is too dark to be measured: take longer exposures, or read a brighter place."
        )
    sampling = float(np.sqrt((variances @ weights**2).sum())) / 4
    uneven = max(float(parts.std(ddof=1)) / 2, sampling)
    if uneven > MOST_UNEVEN * luminance:
        raise CalibrationError(
            f"{place} is too uneven: mark an area within what the meter saw that is of one brightness."
        )
    return luminance, float(np.hypot(uneven, np.abs(weights) @ curve)) / luminance


def _require_light(merged: Merged, place: str) -> None:
    """CalibrationError if much of the area is a bound and no number."""
    if merged.clipped.mean() > MOST_LOST:
        raise CalibrationError(
            f"{place} is saturated in every exposure: take a shorter one, or read a dimmer place."
        )
    if merged.dark.mean() > MOST_LOST:
        raise CalibrationError(
            f"{place} is black in every exposure: take a longer one, or read a brighter place."
        )


def _exposure_error(record: CalibrationRecord) -> float:
    """Relative, of the exposures that the area was taken with against those of the rest of the session."""
    rung = next((rung for rung in record.rungs if rung.name == "exposure_ratios"), None)
    if rung is not None and rung.taken and rung.standard_error is not None:
        return rung.standard_error / 100
    several = len({round(float(np.log(k)), 3) for k in record.exposure_scale.values()}) > 1
    measured = any(camera.response.residual is not None for camera in record.cameras)
    return EXPOSURE_ERROR if several and not measured else 0.0
