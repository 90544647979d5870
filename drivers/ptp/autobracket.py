"""Brackets that a body shoots by itself (AEB): which of those that it offers holds what is wanted."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from drivers.ptp.exposure import SAME, apart
from imaging.optics.exposure import Exposure

FEWEST = 3
"""Exposures for which a bracket is worth its order: no body has one of fewer frames to both sides."""


@dataclass(frozen=True)
class AutoBracket:
    """Automatic bracket of a body: frames around the set exposure, `thirds` of a stop apart.

    code: the number by which the body knows it.
    """

    code: int
    thirds: int
    frames: int


@dataclass(frozen=True)
class Fit:
    """A bracket that holds all that is wanted, and the exposure in its middle, to which the body is set."""

    bracket: AutoBracket
    middle: Exposure


def best_fit(
    exposures: Sequence[Exposure], offered: Iterable[AutoBracket], times: Sequence[float]
) -> Fit | None:
    """The offered bracket that holds the most of the exposures, neighbours in time.

    None if none holds FEWEST of them.
    """
    wanted, brackets = sorted(exposures, key=lambda exposure: exposure.time), tuple(offered)
    for count in range(len(wanted), FEWEST - 1, -1):
        for first in range(len(wanted) - count + 1):
            candidate = fit(wanted[first : first + count], brackets, times)
            if candidate is not None:
                return candidate
    return None


def fit(exposures: Sequence[Exposure], offered: Iterable[AutoBracket], times: Sequence[float]) -> Fit | None:
    """The offered bracket with the fewest frames that holds all the exposures; None if none does.

    They must differ in time alone, by even steps. times: those on the dial, s. Frames too many are shorter
    ones, which cost least, and are on the dial too.
    """
    wanted = sorted(exposures, key=lambda exposure: exposure.time)
    if len(wanted) < 2 or len({(one.f_number, one.iso) for one in wanted}) > 1 or not times:
        return None
    stops = [math.log2(after.time / before.time) for before, after in pairwise(wanted)]
    thirds = round(3 * sum(stops) / len(stops))
    if thirds < 1 or any(abs(step - thirds / 3) > SAME for step in stops):
        return None
    for bracket in sorted(offered, key=lambda one: one.frames):
        more = bracket.frames - len(wanted)
        middle = bracket.frames // 2 - more
        shortest = wanted[0].time / 2 ** (more * thirds / 3)
        on_dial = any(apart(shortest, time) <= SAME for time in times)
        if bracket.thirds == thirds and more >= 0 and middle >= 0 and on_dial:
            return Fit(bracket, wanted[middle])
    return None


def shows(stated: Exposure | None, wanted: Exposure) -> bool:
    """Return whether a file that states this exposure was exposed as is wanted."""
    if stated is None:
        return False
    pairs = (
        (stated.time, wanted.time),
        (stated.f_number, wanted.f_number),
        (stated.iso, wanted.iso),
    )
    return all(apart(said, asked) <= SAME for said, asked in pairs if said and asked)
