"""One bracket as a linear EXR file that says all that is needed to read it: R, G, B, and in parts of their
own, which are no light, sigma.R, sigma.G, sigma.B, and mask.

sigma is of the noise, for RAW of the interpolation of missing colours too, and for photographs of the
standard error of their response. It is infinite where the light is a bound or interpolated from one, so that
1 / sigma^2 weighs it rightly. Where the calibration has a scale of luminance, the header has OpenEXR's
whiteLuminance, cd/m2 of the value (1, 1, 1).

Pixels that a mask excludes in one exposure are left out of the merge where another exposure shows the place.
Pixels excluded in all of them are merged without the mask, and flagged: the light is kept, since a hole could
not be filled again.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.exports.merge_warnings import warnings_of
from imaging.arrays import Array32, Mask
from imaging.dial_settings import meant
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr import read_exr_header, white_luminance, write_exr
from imaging.merge import alignment
from imaging.merge.curve_error import with_curve_error
from imaging.merge.ghosts import TOLERANCE, without_ghosts
from imaging.merge.linear_frame import LinearFrame, read_linear
from imaging.merge.masks import mask_of, without
from imaging.merge.picture import BITS, CLIPPED, DARK, GHOST, HIDDEN, picture_of
from imaging.session.calibration import CameraCalibration, Response
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from imaging.spaces import SPACE_NAMES, SPACE_PRIMARIES, Space

VERSION = 6
"""Version of the format; another number makes every file anew."""
UNIT = (
    "light times rig:exposureFactor; light is signal (1 = white) per second of exposure scale "
    "k = time * ISO/100 / f-number^2"
)
SIGMA = "standard deviation; infinite (no weight) where a bound has a say, NaN where there is no number"
PAIR = 0.954
"""Median difference of two exposures over the standard deviation of one: 0.6745 times the root of two."""


@dataclass(frozen=True)
class MergedView:
    """Result of one bracket; shares are of the pixels, in any channel.

    clipped, dark, ghost: of the pixels that are not hidden. hidden: behind a mask in every exposure. shift:
    largest between two exposures, px; None if it cannot be measured. reused: a file of an earlier run was up
    to date. warnings: advice for the next capture.
    """

    view: ViewId
    file: Path
    exposures: int
    clipped: float
    dark: float
    ghost: float
    hidden: float
    shift: float | None
    reused: bool
    warnings: tuple[str, ...]


def merge_view(
    session: Session,
    path: Path,
    view: ViewId,
    shots: Sequence[ShotRecord],
    camera: CameraCalibration | None,
    scales: Mapping[str, float] | None,
    space: Space,
    factor: float,
    absolute: tuple[float, float] | None,
    white_balance: tuple[float, float, float] | None,
) -> MergedView:
    """Merge a bracket; absolute: cd/m2 of light of 1, and its standard error, where they are known."""
    kind = session.camera(view.camera).kind
    if kind == "raw" and space != "rec709" and (camera is None or camera.camera_from_rec709 is None):
        raise InputError(
            f"{session.folder}: the colour of camera {view.camera} is not known, so it cannot become "
            f"{space}: run `rig calibrate`, or leave --space out."
        )
    k = exposure_scales(session, shots, scales)
    response = camera.response if camera is not None else assumed_response(kind)
    key = _key(session, shots, k, response, camera, [space, factor, absolute, white_balance])
    reused = _finished(path, key)
    if reused is not None:
        clipped, dark, ghost, hidden, shift, said = reused
        return MergedView(view, path, len(shots), clipped, dark, ghost, hidden, shift, True, tuple(said))
    sensors = () if camera is None else camera.sensors
    frames = [
        read_linear(session.file(shot), kind, scale, response, sensors)
        for shot, scale in zip(shots, k, strict=True)
    ]
    if any(one.signal.shape != frames[0].signal.shape for one in frames):
        raise InputError(
            f"the shots of camera {view.camera} at frame {view.frame} differ in size: delete the odd one out."
        )
    frames, usable, behind = _masked(session, shots, frames)
    best = without_ghosts(frames, max(TOLERANCE, (response.residual or 0.0) / PAIR), behind)
    best = replace(best, merged=with_curve_error(best.merged, frames, response))
    picture = picture_of(best, frames[0].cfa, camera, space, white_balance)
    moved = alignment.shifts(usable)
    shift = max((one.size for one in moved), default=None)
    shown_mask = picture.mask if behind is None or behind.all() else picture.mask[~behind]
    clipped, dark, ghost = (float(np.mean(shown_mask & bit > 0)) for bit in (CLIPPED, DARK, GHOST))
    hidden = 0.0 if behind is None else float(behind.mean())
    shares = (clipped, dark, ghost)
    warnings = warnings_of(usable, shares, shift, check_labels=scales is None)
    attributes: dict[str, str | float] = {
        "rig:key": key,
        "rig:view": str(view),
        "rig:units": UNIT,
        "rig:exposureFactor": factor,
        "rig:mask": BITS,
        "rig:exposures": "labels" if scales is None else "calibration",
        "rig:k": json.dumps(sorted(k)),
        "rig:response": response.evidence,
        "rig:noise": "unknown: no sigma" if picture.sigma is None else f"{best.noise:.3g} times its model",
        "rig:sigma": SIGMA,
        "rig:colour": SPACE_NAMES[space] if picture.known_colour else "camera RGB",
        "rig:result": json.dumps([*shares, hidden, shift, warnings]),
    }
    if absolute is not None and picture.known_colour:
        attributes |= white_luminance(absolute[0] / factor, absolute[1] / factor)
    exposed = np.float32(factor)
    channels = {letter: exposed * picture.light[..., index] for index, letter in enumerate("RGB")}
    data: dict[str, dict[str, Array32]] = {}
    if picture.sigma is not None:
        sigmas = exposed * picture.sigma
        data["sigma"] = {f"sigma.{letter}": sigmas[..., index] for index, letter in enumerate("RGB")}
    flags = picture.mask if behind is None else picture.mask | (HIDDEN * behind)
    data["mask"] = {"mask": flags.astype(np.float32)}
    primaries = SPACE_PRIMARIES[space] if picture.known_colour else None
    write_exr(path, channels, primaries=primaries, attributes=attributes, data=data)
    return MergedView(view, path, len(shots), *shares, hidden, shift, False, warnings)


def _masked(
    session: Session, shots: Sequence[ShotRecord], frames: Sequence[LinearFrame]
) -> tuple[list[LinearFrame], list[LinearFrame], Mask | None]:
    """The frames for merging, for the comparison of exposures, and the mask of pixels excluded in all (None:
    empty).
    """
    counts = [mask_of(session, shot, *frames[0].signal.shape[:2]) for shot in shots]
    visible = [without(frame, counted) for frame, counted in zip(frames, counts, strict=True)]
    masks = [counted for counted in counts if counted is not None]
    if not masks:
        return list(frames), visible, None
    hidden = ~np.logical_or.reduce(masks) if len(masks) == len(counts) else np.zeros(masks[0].shape, bool)
    merged = [
        without(frame, None if counted is None else counted | hidden)
        for frame, counted in zip(frames, counts, strict=True)
    ]
    return merged, visible, hidden


def assumed_response(kind: str) -> Response:
    """Response of a camera without a calibration."""
    if kind == "ldr":
        return Response(kind="srgb", evidence="sRGB assumed: there is no calibration")
    return Response(kind="linear", evidence="taken as linear: there is no calibration")


def exposure_scales(
    session: Session, shots: Sequence[ShotRecord], scales: Mapping[str, float] | None
) -> list[float]:
    """Exposure scales of a bracket: of the calibration, else of the labels; 1 where a single shot has
    none.

    Nominal shutter times of a still camera count as the exact powers of two.
    """
    if scales is not None and all(shot.file in scales for shot in shots):
        return [scales[shot.file] for shot in shots]
    exposures = [shot.exposure for shot in shots]
    known = [exposure for exposure in exposures if exposure is not None]
    if len(known) == len(shots):
        exact = meant(known)
        return [exact[exposure].scale for exposure in known]
    if len(shots) == 1:
        return [1.0]
    blank = shots[exposures.index(None)]
    raise InputError(
        f"{session.folder}: {blank.file} has no exposure, so its bracket cannot be merged: run "
        "`rig calibrate`, or import it with a list of exposures."
    )


def _key(
    session: Session,
    shots: Sequence[ShotRecord],
    k: Sequence[float],
    response: Response,
    camera: CameraCalibration | None,
    asked: Sequence[object],
) -> str:
    """Digest of all that a file is made from; asked: space, factor, scale and white balance."""
    parts: list[object] = [
        VERSION,
        asked,
        [[shot.sha256, scale] for shot, scale in zip(shots, k, strict=True)],
    ]
    parts.append(response.model_dump(mode="json"))
    masks = [session.mask(shot) for shot in shots]
    parts.append([None if mask is None else store.sha256(mask) for mask in masks])
    if camera is not None:
        parts.append(camera.model_dump(mode="json", exclude={"lens", "cam_from_rig"}))
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _finished(path: Path, key: str) -> tuple[float, float, float, float, float | None, list[str]] | None:
    """Shares, shift and warnings of a file with the same inputs, or None."""
    if not path.is_file():
        return None
    try:
        attributes = read_exr_header(path).attributes
        clipped, dark, ghost, hidden, shift, said = json.loads(str(attributes["rig:result"]))
    except (InputError, KeyError, ValueError):
        return None
    return (clipped, dark, ghost, hidden, shift, said) if attributes.get("rig:key") == key else None
