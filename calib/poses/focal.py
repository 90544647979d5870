"""Decision on a focal length: from the scene, or from elsewhere where the scene does not determine it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, exp, log, sqrt
from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import Free, adjust
from calib.adjustment.focal_evidence import CHANGE, DETERMINED, effect
from calib.adjustment.focal_priors import FocalPrior
from calib.sensor.focal_length import FocalLength
from imaging.and_list import and_more
from imaging.files.colmap import pycolmap
from imaging.session.calibration import FOCAL_UNDETERMINED
from imaging.session.records import Rung

NAMED = 4
"""Cameras that a warning names."""
TYPICAL, DIFFER = 1.0, 0.45
"""Focal length of cameras of which no file states any, in long sides of the image, and the standard deviation
of its natural logarithm: telephones have 0.65 to 0.8, compact cameras 0.7 to 1.1, a kit's zoom 0.75 to 2.3.
Three photographs of books on a table fitted 7.4 to 0.04 px."""
LEAST, MOST = 0.3, 4.0
"""The same that hardly a lens is beyond. Within, the value of the points stays: ten tourists' photographs of
a church turn within 0.9 degrees of where pycolmap has them, and within 2.8 if all are drawn to what is
typical."""
STEP = 1.25
"""Factor by which a focal length moves at most before all else is adjusted to it."""


def focal_priors(stated: Mapping[int, FocalLength]) -> dict[int, FocalPrior]:
    """Return the files' focal lengths as a term of the adjustment, by COLMAP's number of a camera."""
    return {number: FocalPrior(one.px, one.spread * one.px) for number, one in stated.items()}


@dataclass(frozen=True)
class _Held:
    """A camera whose focal length is held.

    shift: movement of its points with 10 % more of it, px. spread: relative. stated: the words of a file.
    """

    name: str
    shift: float
    spread: float
    stated: str | None


def _moves(shift: float) -> str:
    return f"{100 * CHANGE:g} % more of it would move points by {shift:.2g} px"


def _undetermined(held: Sequence[_Held], cameras: int) -> str:
    """Words for the cameras, whose focal lengths are held."""
    widest = max(one.spread for one in held)
    up_to = "" if len(held) == 1 else "up to "
    if all(one.stated is not None for one in held):
        words = f"the stated {held[0].stated} is used" if len(held) == 1 else "the stated ones are used"
        used = f"{words}, known to {100 * widest:.2g} %"
    elif all(one.stated is None for one in held):
        used = f"no file states it either, and it may be off by {up_to}{100 * widest:.2g} %"
    else:
        used = f"those stated are used where there are any, and they may be off by up to {100 * widest:.2g} %"
    of = ""
    if cameras > 1:
        of = f"of {and_more([one.name for one in held], NAMED)} "
    moves = _moves(max(one.shift for one in held))
    return (
        f"these photographs {of}do not determine the focal length ({moves} only, as over flat ground seen "
        f"straight down): {used}, and distances along the view with it"
    )


def settle_focal(
    reconstruction: Any,
    free: Free,
    scale: float,
    threads: int,
    names: Mapping[int, str],
    stated: Mapping[str, FocalLength],
) -> tuple[Free, tuple[Rung, ...]]:
    """Hold the focal lengths that the scene does not determine, and adjust the rest of the model to them.

    Args:
        reconstruction: the pycolmap model, adjusted, which is changed where a focal length is held.
        free: how it was adjusted.
        scale: of the Cauchy loss, px.
        threads: of the solver.
        names: of the cameras, by COLMAP's number.
        stated: what files state of the focal lengths, by name.

    Returns:
        `free` with what is held, a rung for each camera whose focal length the scene determines, and one for
        all others.
    """
    moved = effect(reconstruction, free, scale)
    priors, rungs, held = dict(free.focal), [], list[_Held]()
    for number, shift in sorted(moved.items()):
        camera = reconstruction.cameras[number]
        if shift >= DETERMINED * camera.width:
            of = f"of {names[number]} " if len(moved) > 1 else ""
            reason = f"the photographs {of}determine the focal length: {_moves(shift)}"
            rungs.append(Rung(name=FOCAL_UNDETERMINED, taken=False, reason=reason))
            continue
        exif = stated.get(names[number])
        focal = float(camera.mean_focal_length())
        if exif is not None:
            priors[number] = replace(priors[number], held=True)
            spread = exif.spread
        else:
            # As little as the points determine it where what no model knows moves them by so much.
            doubt = CHANGE * DETERMINED * camera.width / max(shift, 1e-12)
            side = max(camera.width, camera.height)
            likely, spread = _likely(focal, doubt, TYPICAL * side)
            focal = focal if LEAST < focal / side < MOST else likely
            priors[number] = FocalPrior(focal, spread * focal, held=True)
        held.append(_Held(names[number], shift, spread, None if exif is None else exif.words))
    if held:
        reason = _undetermined(held, len(moved))
        rungs.append(Rung(name=FOCAL_UNDETERMINED, taken=True, reason=reason))
    if priors == free.focal:
        return free, tuple(rungs)
    _hold(reconstruction, replace(free, focal=priors), scale, threads)
    return replace(free, focal=priors), tuple(rungs)


def _likely(by_points: float, doubt: float, typical: float) -> tuple[float, float]:
    """Weigh a focal length that points hardly determine against those of most cameras, by their logarithms.

    Args:
        by_points: Focal length that the points prefer, px.
        doubt: Its standard deviation, relative.
        typical: That of most cameras, px.

    Returns:
        The focal length, px, and its standard deviation, relative.
    """
    weights = doubt**-2, DIFFER**-2
    mean = (weights[0] * log(by_points) + weights[1] * log(typical)) / sum(weights)
    return exp(mean), 1 / sqrt(sum(weights))


def _hold(reconstruction: Any, free: Free, scale: float, threads: int) -> None:
    """Adjust a model to the focal lengths that are held, which it reaches in small steps.

    Views move along their axes with each step, so that their points stay where they are in the images.
    """
    begun = {
        number: float(reconstruction.cameras[number].mean_focal_length())
        for number, prior in free.focal.items()
        if prior.held and number not in free.fixed
    }
    farthest = max((abs(log(free.focal[number].px / px)) for number, px in begun.items()), default=0.0)
    steps = max(ceil(farthest / log(STEP)), 1)
    for step in range(1, steps + 1):
        reached = dict(free.focal)
        for number, px in begun.items():
            end = free.focal[number]
            reached[number] = end if step == steps else replace(end, px=px * (end.px / px) ** (step / steps))
            _lengthen(reconstruction, number, reached[number].px)
        adjust(reconstruction, replace(free, focal=reached), scale, threads)


def _lengthen(reconstruction: Any, number: int, focal: float) -> None:
    """Give a camera a focal length, px, and its views the distance from their points that goes with it."""
    camera = reconstruction.cameras[number]
    longer = focal / float(camera.mean_focal_length())
    for index in camera.focal_length_idxs():
        parameters = camera.params
        parameters[index] = focal
    for image in map(reconstruction.image, reconstruction.reg_image_ids()):
        points = [point.point3D_id for point in image.points2D if point.has_point3D()]
        if image.camera_id != number or not points or len(list(image.frame.data_ids)) > 1:
            continue
        places = np.stack([reconstruction.points3D[key].xyz for key in points])
        frame = reconstruction.frames[image.frame_id]
        pose = frame.rig_from_world
        along = pose.matrix()[2]
        shift = (longer - 1) * float(np.median(places @ along[:3] + along[3]))
        frame.rig_from_world = pycolmap.Rigid3d(pose.rotation, np.add(pose.translation, [0.0, 0.0, shift]))
