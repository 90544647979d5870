"""Decision on a focal length: from the scene, or from elsewhere where the scene does not determine it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from calib.adjustment.bundle_adjustment import Free, adjust
from calib.adjustment.focal_evidence import CHANGE, DETERMINED, effect
from calib.adjustment.focal_priors import FocalPrior
from calib.adjustment.reduced_curvature import BUILT
from calib.sensor.focal_length import FocalLength
from imaging.session.calibration import FOCAL_UNDETERMINED
from imaging.session.records import Rung

NAMED = 4
"""Cameras that a warning names."""


def focal_priors(stated: Mapping[int, FocalLength]) -> dict[int, FocalPrior]:
    """Return the files' focal lengths as a term of the adjustment, by COLMAP's number of a camera."""
    return {number: FocalPrior(one.px, one.spread * one.px) for number, one in stated.items()}


@dataclass(frozen=True)
class _Held:
    """A camera whose focal length is held.

    shift: movement of its points with 10 % more of it, px. spread: relative. stated: EXIF's words of it.
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
        words = f"EXIF's {held[0].stated} is used" if len(held) == 1 else "EXIF's are used"
        used = f"{words}, known to {100 * widest:.2g} %"
    elif all(one.stated is None for one in held):
        used = f"no file states it either, and it may be off by {up_to}{100 * widest:.2g} %"
    else:
        used = f"EXIF's are used where files state them, and they may be off by up to {100 * widest:.2g} %"
    of = ""
    if cameras > 1:
        named = ", ".join(one.name for one in held[:NAMED])
        more = f" and {len(held) - NAMED} more" if len(held) > NAMED else ""
        of = f"of {named}{more} "
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
            spread = min(
                CHANGE * DETERMINED * camera.width / max(shift, 1e-12), BUILT["fx"] * camera.width / focal
            )
            priors[number] = FocalPrior(focal, spread * focal, held=True)
        held.append(_Held(names[number], shift, spread, None if exif is None else exif.words))
    if held:
        reason = _undetermined(held, len(moved))
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
