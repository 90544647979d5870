"""The bracket planner: the fewest exposures that show every radiance of a scene well enough.

An exposure is good for an interval of radiance: from where it reaches the wanted SNR to where it
clips. On a list in which a longer exposure reaches further down and less far up, covering a range
from its dark end with the shortest exposure that reaches down far enough is the exact answer to set
cover: the n-th longest exposure of any other cover is at least as long, so that neither fewer
exposures nor less time would do. Several cameras that share their exposures keep that property.
Of the brackets with as few exposures that take hardly longer, the one with the best hand-overs is
then taken (capture.bracket.balance).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from capture.bracket.balance import Reach, balance
from capture.bracket.code_noise import CodeNoise
from capture.bracket.goals import BracketGoals
from capture.bracket.raw_noise import RawNoise
from imaging.errors import CaptureError
from imaging.optics.exposure import Exposure

SLACK = 1 / 8
"""Stops by which an exposure is trusted less at both ends: shutters are named by round numbers, and
1/60 s that is 1/64 s is off by 0.09 stops, in the meter's shot as in the planned one."""

BALANCE = 1.25
"""Most time that a bracket may take for better hand-overs, relative to the quickest: less than the next
longer exposure would.
"""


@dataclass(frozen=True)
class Target:
    """Radiance that one colour channel of one camera meets, signal per second of exposure scale.

    dark, bright: its percentiles 0.1 and 99.99. no_darker, no_brighter: False where the meter found
    no end, and `dark` is only known not to be exceeded, `bright` only known to be reached.
    """

    camera: str
    channel: str
    noise: RawNoise | CodeNoise
    dark: float
    bright: float
    no_darker: bool = True
    no_brighter: bool = True

    @property
    def stops(self) -> float:
        """Stops between its ends."""
        return math.log2(self.bright / self.dark)

    def headroom(self, exposure: Exposure) -> float:
        """Stops from the bright end to where an exposure clips; negative if it does."""
        return math.log2(self.noise.brightest(exposure) / self.bright)

    def __str__(self) -> str:
        return f"{self.camera} {self.channel}"


@dataclass(frozen=True)
class Shortfall:
    """Part of a target's range that the bracket misses, in stops."""

    target: str
    part: Literal["dark", "middle", "bright"]
    stops: float
    at_least: bool = False
    """True if it may be more, since the meter found no end."""

    def __str__(self) -> str:
        if self.at_least and self.stops < 0.05:
            return f"{self.target}: the meter found no {self.part} end"
        size = f"{self.stops:.1f}" if self.stops >= 0.05 else "less than 0.1"
        stops = ("at least " if self.at_least else "") + f"{size} stops"
        return {
            "dark": f"{self.target}: the dark end lacks {stops} of light for the wanted SNR",
            "middle": f"{self.target}: {stops} between exposures are in none",
            "bright": f"{self.target}: the bright end clips by {stops}",
        }[self.part]


@dataclass(frozen=True)
class BracketPlan:
    """Exposures in ascending order of their scale, and what they leave out."""

    exposures: tuple[Exposure, ...]
    shortfalls: tuple[Shortfall, ...]

    @property
    def total(self) -> float:
        """Seconds of all exposures together."""
        return sum(exposure.time for exposure in self.exposures)


def plan_bracket(
    targets: Sequence[Target], exposures: Sequence[Exposure], wanted: BracketGoals
) -> BracketPlan:
    """The fewest of `exposures` that show all targets at the wanted SNR, unclipped.

    Of those that take at most BALANCE times as long as the quickest, the one whose SNR where one exposure
    hands over to the next is the highest. exposures: a list as capture.bracket.exposure_choices gives it.
    What cannot be reached is listed. Where the total time does not suffice, the longest exposures are given
    up and with them the dark end, no more than necessary. CaptureError if not even the shortest exposure fits
    into the total time.
    """
    slowest = sorted({exposure.time for exposure in exposures}, reverse=True)
    most = math.inf if wanted.total is None else wanted.total * (1 + 1e-6)
    for longest in slowest:
        usable = _capped(exposures, longest)
        plan = _cover(targets, usable, wanted.snr)
        if plan.total <= most:
            return _balanced(plan, targets, usable, wanted.snr, most)
    raise CaptureError(
        f"no bracket fits into {wanted.total:g} s in all: the quickest takes {plan.total:.3g} s, allow more."
    )


def _balanced(
    plan: BracketPlan, targets: Sequence[Target], exposures: Sequence[Exposure], snr: float, most: float
) -> BracketPlan:
    """Choose as few exposures that miss no more, within `most` seconds, and hardly longer than `plan`."""
    count = len(plan.exposures)
    if count == 1:
        return plan
    reaches = [Reach.of(goal.noise, (goal.dark, goal.bright), exposures, snr, SLACK) for goal in targets]
    times = np.array([exposure.time for exposure in exposures])
    longest = min(most, BALANCE * plan.total) * (1 + 1e-9)  # sums round differently in another order
    chosen = balance(reaches, times, count, longest)
    return replace(plan, exposures=tuple(exposures[index] for index in chosen))


def _capped(exposures: Sequence[Exposure], longest: float) -> list[Exposure]:
    """The list up to a time; there, as at its own end, higher ISOs go on."""
    base = exposures[0].iso
    isos = dict.fromkeys(exposure.iso for exposure in exposures if exposure.iso != base)
    shots = [exposure for exposure in exposures if exposure.iso == base and exposure.time <= longest]
    return [*shots, *(shots[-1].model_copy(update={"iso": iso}) for iso in isos)]


@dataclass
class _Open:
    """A target on the way: `reach` is how far up from its dark end it is covered.

    useful: (index of the exposure, from, to) in ascending order of scale, so that both ends descend.
    """

    target: Target
    reach: float
    useful: list[tuple[int, float, float]]

    def next(self) -> tuple[int, float, float] | None:
        """The shortest exposure that goes on from `reach`, if there is one."""
        first = next((reach for reach in self.useful if reach[1] <= self.reach), None)
        return first if first and (first[2] > self.reach or first[2] >= self.target.bright) else None


def _cover(targets: Sequence[Target], exposures: Sequence[Exposure], snr: float) -> BracketPlan:
    """Set cover from the dark end; what no exposure shows is skipped and listed."""
    waiting = [_Open(target, target.dark, _useful(target, exposures, snr)) for target in targets]
    missed: list[Shortfall] = []
    chosen: set[int] = set()
    while True:
        for opened in waiting:
            while opened.reach < math.inf and opened.next() is None:
                missed.append(_skip(opened))
        needs = [need for opened in waiting if opened.reach < math.inf and (need := opened.next())]
        if not needs:
            break
        # The target that needs the longest exposure cannot do with less; more would reach less far up.
        index = max(need[0] for need in needs)
        chosen.add(index)
        for opened in waiting:
            for number, low, high in opened.useful:
                if number == index and low <= opened.reach <= high:
                    opened.reach = math.inf if high >= opened.target.bright else high
    if not chosen:  # nothing is shown as wanted: the most light that does not clip is the best there is
        fit = [
            index
            for index, exposure in enumerate(exposures)
            if all(target.noise.brightest(exposure) >= target.bright for target in targets)
        ]
        chosen.add(max(fit, default=0))
    missed = [_unbounded(shortfall, targets) for shortfall in _joined(missed)]
    missed += _unknown(targets, missed)
    return BracketPlan(tuple(exposures[index] for index in sorted(chosen)), tuple(missed))


def _useful(target: Target, exposures: Sequence[Exposure], snr: float) -> list[tuple[int, float, float]]:
    """Useful range of each exposure; CaptureError without any: even next to white the SNR is too low."""
    noise, trusted = target.noise, 2.0**SLACK
    ends = [
        (index, noise.darkest(snr, exposure) * trusted, noise.brightest(exposure) / trusted)
        for index, exposure in enumerate(exposures)
    ]
    useful = [end for end in ends if end[1] < end[2]]
    if not useful:
        most = max(noise.snr(high / trusted, exposures[index]) for index, _, high in ends)
        raise CaptureError(
            f"{snr:g} dB are out of the reach of {target.camera}, which gives {most:.1f} dB "
            "where it is nearly white: ask for less with --snr."
        )
    return useful


def _skip(opened: _Open) -> Shortfall:
    """Go on where the next exposure begins to be good, or give the rest up."""
    start, bright, name = opened.reach, opened.target.bright, str(opened.target)
    further = min((low for _, low, _ in opened.useful if low > start), default=None)
    opened.reach = further if further is not None and further <= bright else math.inf
    if further is None:
        return Shortfall(name, "bright", math.log2(bright / max(high for _, _, high in opened.useful)))
    return Shortfall(name, "dark" if start == opened.target.dark else "middle", math.log2(further / start))


def _joined(missed: Sequence[Shortfall]) -> list[Shortfall]:
    """One shortfall for all the gaps in the middle of a target."""
    stops: dict[tuple[str, Literal["dark", "middle", "bright"]], float] = {}
    for shortfall in missed:
        stops[shortfall.target, shortfall.part] = (
            stops.get((shortfall.target, shortfall.part), 0.0) + shortfall.stops
        )
    return [Shortfall(target, part, size) for (target, part), size in stops.items()]


def _unbounded(shortfall: Shortfall, targets: Sequence[Target]) -> Shortfall:
    """A shortfall at an end that the meter did not find is at least as large."""
    target = next(target for target in targets if str(target) == shortfall.target)
    endless = {"dark": not target.no_darker, "middle": False, "bright": not target.no_brighter}
    return replace(shortfall, at_least=endless[shortfall.part])


def _unknown(targets: Sequence[Target], missed: Sequence[Shortfall]) -> list[Shortfall]:
    """An end that the meter did not find is a shortfall even where the plan reaches all that is known."""
    listed = {(shortfall.target, shortfall.part) for shortfall in missed}
    ends: list[Shortfall] = []
    for target in targets:
        if not target.no_darker and (str(target), "dark") not in listed:
            ends.append(Shortfall(str(target), "dark", 0.0, at_least=True))
        if not target.no_brighter and (str(target), "bright") not in listed:
            ends.append(Shortfall(str(target), "bright", 0.0, at_least=True))
    return ends
