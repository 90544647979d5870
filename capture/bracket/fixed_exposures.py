"""Exposures that are chosen otherwise than by a planned bracket: stops around a middle one, and levels."""

import math
from collections.abc import Mapping, Sequence

from capture.bracket.automatic import worths
from capture.bracket.deviation import TOLERANCE_STOPS
from capture.bracket.exposure_choices import common_isos, common_times, exposure_list
from capture.bracket.goals import BracketGoals
from capture.bracket.planner import Target
from drivers.camera import Camera
from imaging.errors import CaptureError, InputError
from imaging.optics.exposure import Exposure

LEVELS, LEVEL_STOPS = 12, 2 / 3
"""Levels of a flat and their distance: from 90 % of white down to 0.6 %, where read noise rules."""
FULL = 0.9
"""The brightest level of a flat, white 1: further up noise begins to be cut off."""
STILL = 1 / 30
"""Seconds within which a board that is held by hand stands still enough for its corners."""
VISIBLE = 10.0
"""dB at which the dark end of a single exposure counts as seen."""


def exposures_around(
    middle: Exposure, stops: Sequence[float], cameras: Mapping[str, Camera]
) -> tuple[Exposure, ...]:
    """The nearest exposures that the cameras have; InputError if one is out of reach or comes twice."""
    if not stops:
        raise InputError("the bracket is empty: give at least one exposure, as 0 or -2,0,2.")
    times = common_times([camera.capabilities() for camera in cameras.values()])
    slack = 2.0**TOLERANCE_STOPS
    chosen: list[Exposure] = []
    for stop in stops:
        if not math.isfinite(stop) or abs(stop) > 64:
            raise InputError(f"{stop} is not an exposure: give stops relative to the middle, such as -2,0,2.")
        ideal = middle.with_time(middle.time * 2.0**stop)
        if not times[0] / slack <= ideal.time <= times[-1] * slack:
            least, most = math.log2(times[0] / middle.time), math.log2(times[-1] / middle.time)
            raise InputError(
                f"{stop:+g} stops from {middle} is {ideal}, out of reach of the cameras: "
                f"choose stops between {least:+.1f} and {most:+.1f}."
            )
        nearest = middle.with_time(_nearest(times, ideal.time))
        if nearest in chosen:
            raise InputError(
                f"{stop:+g} stops gives {nearest} a second time: choose stops at least 1/3 apart."
            )
        chosen.append(nearest)
    return tuple(chosen)


def single_exposures(
    cameras: Mapping[str, Camera], f_number: float | None, slowest: float | None = None
) -> tuple[Exposure, ...]:
    """Exposures for a single shot, ascending: at the lowest ISO, or higher ones once the time is up."""
    able = [camera.capabilities() for camera in cameras.values()]
    listed = exposure_list(common_times(able), common_isos(able), f_number, BracketGoals(slowest=slowest))
    return listed if slowest is not None else tuple(e for e in listed if e.iso == listed[0].iso)


def middle_exposure(targets: Sequence[Target], exposures: Sequence[Exposure]) -> Exposure:
    """The exposure with as many stops to spare, or missing, above what all cameras see as below it."""

    def off(exposure: Exposure) -> float:
        below = min(math.log2(target.dark / target.noise.darkest(VISIBLE, exposure)) for target in targets)
        return abs(worths(targets, exposure)["rig"].headroom - below)

    return min(exposures, key=off)


def flat_levels(targets: Sequence[Target], exposures: Sequence[Exposure]) -> tuple[Exposure, ...]:
    """Levels of a flat, ascending: the brightest that leaves all cameras below white, and down from it.

    CaptureError if even the shortest is too bright for one.
    """
    bright = max(target.bright for target in targets)
    fit = [exposure for exposure in exposures if bright * exposure.scale <= FULL]
    if not fit:
        raise CaptureError(
            f"the flat is too bright: {exposures[0]} is above 90 % of white; dim the light or use a filter."
        )
    top = fit[-1]
    wanted = [top.time * 2.0 ** (-LEVEL_STOPS * level) for level in range(LEVELS)]
    times = [exposure.time for exposure in fit]
    # A camera without shorter times has fewer levels.
    chosen = {_nearest(times, time) for time in wanted if time >= times[0] / 2.0**TOLERANCE_STOPS}
    return tuple(top.with_time(time) for time in sorted(chosen))


def _nearest(times: Sequence[float], time: float) -> float:
    return min(times, key=lambda choice: abs(math.log2(choice / time)))
