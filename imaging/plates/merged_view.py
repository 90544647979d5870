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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from imaging.arrays import Array, Array32, Mask
from imaging.choices import SPACE_NAMES, SPACE_PRIMARIES, ExrStorage, Space
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr.camera import camera_attributes, capture_date
from imaging.files.exr.reading import read_exr_header
from imaging.files.exr.writing import EXPOSURE_FACTOR, ExrValue, white_luminance, write_exr
from imaging.merge import alignment
from imaging.merge.curve_error import with_curve_error
from imaging.merge.ghosts import TOLERANCE, without_ghosts
from imaging.merge.linear_frame import LinearFrame, read_linear
from imaging.merge.masks import mask_of, without
from imaging.merge.picture import BITS, CLIPPED, DARK, GHOST, HIDDEN, Picture, picture_of
from imaging.optics.lens import Lens
from imaging.plates.bracket_advice import warnings_of
from imaging.plates.bracket_exposures import exposure_scales, response_of
from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId

VERSION = 7
"""Version of the format; another number makes every file anew."""
UNIT = (
    "light times rig:exposureFactor; light is signal (1 = white) per second of exposure scale "
    "k = time * ISO/100 / f-number^2"
)
SIGMA = "standard deviation; infinite (no weight) where a bound has a say, NaN where there is no number"
CAMERA_RGB = "camera RGB"
"""Colour of a file in no known space."""
PAIR = 0.954
"""Median difference of two exposures over the standard deviation of one: 0.6745 times the root of two."""


@dataclass(frozen=True)
class MergedView:
    """Result of one bracket; shares are of the pixels, in any channel.

    clipped, dark, ghost: of the pixels that are not hidden. hidden: behind a mask in every exposure. shift:
    largest between two exposures, px; None if it cannot be measured. known_colour: the file is in the space
    that was asked for, and not in camera RGB. reused: a file of an earlier run was up to date. warnings:
    advice for the next capture.
    """

    view: ViewId
    file: Path
    exposures: int
    clipped: float
    dark: float
    ghost: float
    hidden: float
    shift: float | None
    known_colour: bool
    reused: bool
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ViewLight:
    """A merged bracket in memory: its picture, and what was found out on the way.

    The picture is in the unit of the calibration, its mask has HIDDEN too. noise: factor on the noise model.
    """

    picture: Picture
    noise: float
    clipped: float
    dark: float
    ghost: float
    hidden: float
    shift: float | None
    warnings: tuple[str, ...]


def view_light(
    session: Session,
    view: ViewId,
    shots: Sequence[ShotRecord],
    calibration: CalibrationRecord | None,
    space: Space = "rec709",
) -> ViewLight:
    """Merge a bracket: light, its standard deviation and a mask, by a calibration or without one.

    Args:
        session: Session.
        view: Camera and frame of the bracket.
        shots: Shots of the bracket.
        calibration: Calibration of the session; None: exposures are those of the labels, and the response is
            assumed.
        space: Colour space of the light.

    Returns:
        The picture, and the clipped, dark, ghost and hidden shares of its pixels, with warnings.

    Raises:
        InputError: A file is missing or damaged, an exposure unknown, the shots differ in size, or the colour
            of the camera is unknown where a space other than Rec.709 needs it.
    """
    camera = None if calibration is None else calibration.camera(view.camera)
    scales = None if calibration is None else calibration.exposure_scale
    kind, response = session.camera(view.camera).kind, response_of(session, view.camera, calibration)
    sensors = () if camera is None else camera.sensors
    frames = [
        read_linear(session.file(shot), kind, scale, response, sensors)
        for shot, scale in zip(shots, exposure_scales(session, shots, scales), strict=True)
    ]
    cfa = frames[0].cfa
    grey = cfa is not None and cfa.mono  # of all spaces alike
    uncoloured = kind == "raw" and not grey and (camera is None or camera.camera_from_rec709 is None)
    if uncoloured and space != "rec709":
        raise InputError(
            f"{session.folder}: the colour of camera {view.camera} is not known, so it cannot become "
            f"{space}: run `rig calibrate`, or leave --space out."
        )
    if any(one.signal.shape != frames[0].signal.shape for one in frames):
        raise InputError(
            f"the shots of camera {view.camera} at frame {view.frame} differ in size: delete the odd one out."
        )
    frames, usable, behind = _masked(session, shots, frames)
    best = without_ghosts(frames, max(TOLERANCE, (response.residual or 0.0) / PAIR), behind)
    best = replace(best, merged=with_curve_error(best.merged, frames, response))
    white = white_balance(session, view, calibration)
    picture = picture_of(best, cfa, camera, space, white)
    shift = max((one.size for one in alignment.shifts(usable)), default=None)
    shown_mask = picture.mask if behind is None or behind.all() else picture.mask[~behind]
    clipped, dark, ghost = shares = [float(np.mean(shown_mask & bit > 0)) for bit in (CLIPPED, DARK, GHOST)]
    warnings = warnings_of(
        usable, shares, shift, check_labels=scales is None, assumed_curve=response.kind == "srgb"
    )
    hidden = 0.0
    if behind is not None:
        picture, hidden = replace(picture, mask=picture.mask | (HIDDEN * behind)), float(behind.mean())
    return ViewLight(picture, best.noise, clipped, dark, ghost, hidden, shift, warnings)


@dataclass(frozen=True)
class PlateFormat:
    """Values of a file: primaries, their factor on the light, and their storage."""

    space: Space
    factor: float
    storage: ExrStorage = "float"


def merge_view(
    session: Session,
    path: Path,
    view: ViewId,
    shots: Sequence[ShotRecord],
    calibration: CalibrationRecord | None,
    plate: PlateFormat,
) -> MergedView:
    """Merge a bracket into a file; one with the same inputs stays as it is.

    Args:
        session: Session.
        path: EXR file to write.
        view: Camera and frame of the bracket.
        shots: Shots of the bracket.
        calibration: Calibration of the session; None: as in `view_light`.
        plate: Colour space of the file, the factor on its light, and its storage.

    Returns:
        The file, and the clipped, dark, ghost and hidden shares of its pixels, with warnings.

    Raises:
        InputError: The bracket cannot be merged, as in `view_light`, or its light is too large for the
            storage.
        StorageError: The disk refuses.
    """
    space, factor, storage = plate.space, plate.factor, plate.storage
    camera = None if calibration is None else calibration.camera(view.camera)
    scales = None if calibration is None else calibration.exposure_scale
    response, k = response_of(session, view.camera, calibration), exposure_scales(session, shots, scales)
    absolute = None
    if calibration is not None and (known := calibration.luminance) and view.camera in known.cameras:
        absolute = known.value / factor, known.error / factor
    placed = _placed(view, calibration)
    stands = None if placed is None else [one.tolist() for one in (placed[0], placed[1].matrix)]
    made = [space, factor, storage, absolute, white_balance(session, view, calibration), stands]
    key = _key(session, shots, k, response, camera, made)
    reused = _finished(view, path, len(shots), key)
    if reused is not None:
        return reused
    merged = view_light(session, view, shots, calibration, space)
    picture, numbers = (
        merged.picture,
        (merged.clipped, merged.dark, merged.ghost, merged.hidden, merged.shift),
    )
    attributes: dict[str, ExrValue] = {
        "rig:key": key,
        "rig:view": str(view),
        "rig:units": UNIT,
        EXPOSURE_FACTOR: factor,
        "rig:mask": BITS,
        "rig:exposures": "labels" if scales is None else "calibration",
        "rig:k": json.dumps(sorted(k)),
        "rig:response": response.evidence,
        "rig:noise": "unknown: no sigma" if picture.sigma is None else f"{merged.noise:.3g} times its model",
        "rig:sigma": SIGMA,
        "rig:colour": SPACE_NAMES[space] if picture.known_colour else CAMERA_RGB,
        "rig:result": json.dumps([*numbers, merged.warnings]),
        "software": f"rig {version('hdr-rig')}",
        **_camera_of(shots, placed),
    }
    if absolute is not None and picture.known_colour:
        attributes |= white_luminance(*absolute)
    exposed = np.float32(factor)
    channels = {letter: exposed * picture.light[..., index] for index, letter in enumerate("RGB")}
    data: dict[str, dict[str, Array32]] = {}
    if picture.sigma is not None:
        sigmas = exposed * picture.sigma
        data["sigma"] = {f"sigma.{letter}": sigmas[..., index] for index, letter in enumerate("RGB")}
    data["mask"] = {"mask": picture.mask.astype(np.float32)}
    primaries = SPACE_PRIMARIES[space] if picture.known_colour else None
    write_exr(path, channels, primaries=primaries, attributes=attributes, data=data, storage=storage)
    return MergedView(view, path, len(shots), *numbers, picture.known_colour, False, merged.warnings)


def _placed(view: ViewId, calibration: CalibrationRecord | None) -> tuple[Array, Lens] | None:
    """Pose, camera from world [4, 4], and lens of a view; None where one of them is not known."""
    lens = None if calibration is None else calibration.camera(view.camera).lens
    if lens is None or calibration is None:
        return None
    poses = (placed.cam_from_world.matrix() for placed in calibration.views if placed.id == view)
    pose = next(poses, None)
    return None if pose is None else (pose, lens)


def _camera_of(shots: Sequence[ShotRecord], placed: tuple[Array, Lens] | None) -> dict[str, ExrValue]:
    """Attributes of the camera, where its pose is known, and the date of the first shot, where that is."""
    taken = next((shot.captured_at for shot in shots if shot.captured_at is not None), None)
    dated = {} if taken is None else capture_date(taken)
    if placed is None:
        return dated
    motion, lens = placed
    return dated | camera_attributes(motion, lens.matrix, (lens.width, lens.height))


def white_balance(
    session: Session, view: ViewId, calibration: CalibrationRecord | None
) -> tuple[float, float, float] | None:
    """White balance that a photograph was developed with; None of RAW, and of views without a pose."""
    if calibration is None or session.camera(view.camera).kind != "ldr":
        return None
    return next((placed.white_balance for placed in calibration.views if placed.id == view), None)


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


def _key(
    session: Session,
    shots: Sequence[ShotRecord],
    k: Sequence[float],
    response: Response,
    camera: CameraCalibration | None,
    asked: Sequence[object],
) -> str:
    """Digest of all that a file is made from.

    asked: space, factor, storage, scale, white balance and camera.
    """
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


def _finished(view: ViewId, path: Path, exposures: int, key: str) -> MergedView | None:
    """Return the result of an earlier run if its file has the same inputs, or None."""
    if not path.is_file():
        return None
    try:
        attributes = read_exr_header(path).attributes
        clipped, dark, ghost, hidden, shift, said = json.loads(str(attributes["rig:result"]))
        known_colour = attributes["rig:colour"] != CAMERA_RGB
    except (InputError, KeyError, ValueError):
        return None
    if attributes.get("rig:key") != key:
        return None
    return MergedView(
        view, path, exposures, clipped, dark, ghost, hidden, shift, known_colour, True, tuple(said)
    )
