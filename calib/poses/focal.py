"""Decision on a focal length: from the scene, or from elsewhere where the scene does not determine it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from calib.adjustment.bundle_adjustment import Free, adjust
from calib.adjustment.focal_evidence import CHANGE, DETERMINED, effect
from calib.adjustment.focal_priors import FocalPrior
from calib.adjustment.reduced import BUILT
from calib.sensor.focal_length import FocalLength
from imaging.session.calibration import FOCAL_UNDETERMINED
from imaging.session.records import Rung


def focal_priors(stated: Mapping[int, FocalLength]) -> dict[int, FocalPrior]:
    """Return the files' focal lengths as a term of the adjustment, by COLMAP's number of a camera."""
    return {number: FocalPrior(one.px, one.spread * one.px) for number, one in stated.items()}


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
        `free` with what is held, and a rung for each camera whose lens is adjusted.
    """
    moved = effect(reconstruction, free, scale)
    priors, rungs = dict(free.focal), []
    for number, shift in sorted(moved.items()):
        camera = reconstruction.cameras[number]
        of = f"of {names[number]} " if len(moved) > 1 else ""
        size = f"{100 * CHANGE:g} % more of it would move points by {shift:.2g} px only"
        if shift >= DETERMINED * camera.width:
            size = size.removesuffix(" only")
            reason = f"the photographs {of}determine the focal length: {size}"
            rungs.append(Rung(name=FOCAL_UNDETERMINED, taken=False, reason=reason))
            continue
        exif = stated.get(names[number])
        focal = float(camera.mean_focal_length())
        if exif is not None:
            priors[number] = replace(priors[number], held=True)
            used = f"EXIF's {exif.words} is used, known to {100 * exif.spread:.2g} %"
        else:
            # As little as the points determine it where what no model knows moves them by so much.
            spread = min(
                CHANGE * DETERMINED * camera.width / max(shift, 1e-12), BUILT["fx"] * camera.width / focal
            )
            priors[number] = FocalPrior(focal, spread * focal, held=True)
            used = f"no file states it either, and it may be off by {100 * spread:.2g} %"
        reason = (
            f"these photographs {of}do not determine the focal length ({size}, as over flat ground seen "
            f"straight down): {used}, and distances along the view with it"
        )
        rungs.append(Rung(name=FOCAL_UNDETERMINED, taken=True, reason=reason))
    if priors == free.focal:
        return free, tuple(rungs)
    free = replace(free, focal=priors)
    for number, prior in priors.items():
        camera = reconstruction.cameras[number]
        if prior.held and number not in free.fixed:
            for index in camera.focal_length_idxs():
                parameters = camera.params
                parameters[index] = prior.px
    adjust(reconstruction, free, scale, threads)
    return free, tuple(rungs)
