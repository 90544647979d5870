"""The exposures that the planner may choose from: what all cameras have, within the limits."""

from collections.abc import Iterable, Sequence

from capture.bracket.deviation import deviates
from capture.bracket.goals import BracketGoals
from capture.bracket.planner import SLACK, Target
from drivers.camera import Capabilities
from imaging.errors import CaptureError, InputError
from imaging.optics.exposure import Exposure


def common_times(capabilities: Iterable[Capabilities]) -> tuple[float, ...]:
    """Shutter times that every camera has, ascending, as the first names them; CaptureError if none."""
    first, *others = capabilities
    times = tuple(
        time
        for time in first.times
        if all(any(not deviates(_bare(time), _bare(t)) for t in other.times) for other in others)
    )
    if not times:
        raise CaptureError("the cameras have no shutter time in common: set each to manual exposure.")
    return times


def common_isos(capabilities: Iterable[Capabilities]) -> tuple[float | None, ...]:
    """ISO speeds that every camera has, ascending; (None,) if one of them names none."""
    first, *others = (set(able.isos) for able in capabilities)
    shared = first.intersection(*others)
    return tuple(sorted(shared)) or (None,)


def _bare(time: float) -> Exposure:
    return Exposure(time=time)


def exposure_list(
    times: Sequence[float], isos: Sequence[float | None], f_number: float | None, wanted: BracketGoals
) -> tuple[Exposure, ...]:
    """The exposures to choose from, in ascending order of their scale.

    Up to the slowest time at the lowest ISO; then, since no more light is to be had, at higher ones.

    Args:
        times: Shutter times that all cameras have, s.
        isos: ISO speeds that all cameras have, ascending; (None,) if one of them names no ISO.
        f_number: F-number of all exposures; None: unknown.
        wanted: Goals, of which the slowest time and the highest ISO are limits here.

    Returns:
        Every allowed time at the lowest ISO, then the slowest of them at each higher ISO.

    Raises:
        InputError: A limit leaves no exposure.
    """
    allowed = [time for time in times if wanted.slowest is None or time <= wanted.slowest * (1 + 1e-6)]
    if not allowed:
        raise InputError(
            f"no exposure is {_bare(wanted.slowest or 0)} or shorter: the fastest is {_bare(min(times))}."
        )
    low_enough = [
        iso for iso in isos if iso is None or wanted.highest_iso is None or iso <= wanted.highest_iso
    ]
    if not low_enough:
        raise InputError(f"no ISO is {wanted.highest_iso:g} or lower: the lowest is {isos[0]:g}.")
    base, *higher = low_enough
    shots = [Exposure(time=time, f_number=f_number, iso=base) for time in sorted(allowed)]
    return (*shots, *(shots[-1].model_copy(update={"iso": iso}) for iso in higher))


def without_idle_isos(
    targets: Sequence[Target], exposures: Sequence[Exposure], snr: float
) -> tuple[Exposure, ...]:
    """The list without ISOs that show no camera SLACK stops more of the dark than the next lower one kept.

    An ISO takes highlights away, so that an exposure more is needed; a sensor whose read noise is well
    above the rounding gains nothing for it.
    """
    choices: list[Exposure] = [exposures[0]]
    for exposure in exposures[1:]:
        before = choices[-1]
        lower = exposure.model_copy(update={"iso": before.iso})
        gains = (t.noise.darkest(snr, lower) / t.noise.darkest(snr, exposure) for t in targets)
        if exposure.iso == before.iso or max(gains) >= 2.0**SLACK:
            choices.append(exposure)
    return tuple(choices)
