"""The bracket planner: the fewest exposures that show every radiance of a scene well enough.

An exposure is good for an interval of radiance: from where it reaches the wanted SNR to where it
clips. On a list in which a longer exposure reaches further down and less far up, covering a range
from its dark end with the shortest exposure that reaches down far enough is the exact answer to set
cover: the n-th longest exposure of any other cover is at least as long, so that neither fewer
exposures nor less time would do. Several cameras that share their exposures keep that property.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from capture.deviation import deviates
from capture.tones import Tones
from drivers.camera import Capabilities
from imaging.errors import CaptureError, InputError
from imaging.exposure import Exposure

SLACK = 1 / 8
"""Stops by which an exposure is trusted less at both ends: shutters are named by round numbers, and
1/60 s that is 1/64 s is off by 0.09 stops, in the meter's shot as in the planned one."""


@dataclass(frozen=True)
class Wanted:
    """What a bracket has to reach, and what it may not exceed; None: whatever the cameras can do.

    snr: dB; slowest: of one exposure, s; total: of all exposures of a bracket together, s.
    """

    snr: float = 20.0
    slowest: float | None = None
    total: float | None = None
    highest_iso: float | None = None


@dataclass(frozen=True)
class Target:
    """Radiance that one colour channel of one camera meets, signal per second of exposure scale.

    dark, bright: its percentiles 0.1 and 99.99. no_darker, no_brighter: False where the meter found
    no end, and `dark` is only known not to be exceeded, `bright` only known to be reached.
    """

    camera: str
    channel: str
    tones: Tones
    dark: float
    bright: float
    no_darker: bool = True
    no_brighter: bool = True

    @property
    def stops(self) -> float:
        """How far its ends are apart."""
        return math.log2(self.bright / self.dark)

    def headroom(self, exposure: Exposure) -> float:
        """Stops from the bright end to where an exposure clips; negative if it does."""
        return math.log2(self.tones.brightest(exposure) / self.bright)

    def __str__(self) -> str:
        return f"{self.camera} {self.channel}"


@dataclass(frozen=True)
class Shortfall:
    """Part of a target's range that the bracket misses, by so many stops."""

    target: str
    part: Literal["dark", "middle", "bright"]
    stops: float
    at_least: bool = False
    """Whether it may be more, since the meter found no end."""

    def __str__(self) -> str:
        if self.stops == 0.0:
            return f"{self.target}: the meter found no {self.part} end"
        stops = ("at least " if self.at_least else "") + f"{self.stops:.1f} stops"
        return {
            "dark": f"{self.target}: the dark end lacks {stops} of light for the wanted SNR",
            "middle": f"{self.target}: {stops} between two exposures are in neither",
            "bright": f"{self.target}: the bright end clips by {stops}",
        }[self.part]


@dataclass(frozen=True)
class Plan:
    """Exposures in ascending order of their scale, and what they leave out."""

    exposures: tuple[Exposure, ...]
    shortfalls: tuple[Shortfall, ...]

    @property
    def total(self) -> float:
        """Seconds of all exposures together."""
        return sum(exposure.time for exposure in self.exposures)


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
    first, *others = (set(one.isos) for one in capabilities)
    shared = first.intersection(*others)
    return tuple(sorted(shared)) or (None,)


def _bare(time: float) -> Exposure:
    return Exposure(time=time)


def exposure_list(
    times: Sequence[float], isos: Sequence[float | None], f_number: float | None, wanted: Wanted
) -> tuple[Exposure, ...]:
    """The exposures to choose from, in ascending order of their scale; InputError if a limit leaves none.

    Up to the slowest time at the lowest ISO; then, since no more light is to be had, at higher ones.
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
    kept: list[Exposure] = [exposures[0]]
    for exposure in exposures[1:]:
        before = kept[-1]
        lower = exposure.model_copy(update={"iso": before.iso})
        gains = (t.tones.darkest(snr, lower) / t.tones.darkest(snr, exposure) for t in targets)
        if exposure.iso == before.iso or max(gains) >= 2.0**SLACK:
            kept.append(exposure)
    return tuple(kept)


def plan_bracket(targets: Sequence[Target], exposures: Sequence[Exposure], wanted: Wanted) -> Plan:
    """The fewest of `exposures` that show all targets at the wanted SNR, unclipped; of those, the quickest.

    exposures: a list as `exposure_list` gives it. What cannot be reached is listed. Where the total
    time does not suffice, the longest exposures are given up and with them the dark end, no more
    than necessary. CaptureError if not even the shortest exposure fits into the total time.
    """
    slowest = sorted({exposure.time for exposure in exposures}, reverse=True)
    for longest in slowest:
        plan = _cover(targets, _capped(exposures, longest), wanted.snr)
        if wanted.total is None or plan.total <= wanted.total * (1 + 1e-6):
            return plan
    raise CaptureError(
        f"no bracket fits into {wanted.total:g} s in all: the quickest takes {plan.total:.3g} s, allow more."
    )


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
        first = next((one for one in self.useful if one[1] <= self.reach), None)
        return first if first and (first[2] > self.reach or first[2] >= self.target.bright) else None


def _cover(targets: Sequence[Target], exposures: Sequence[Exposure], snr: float) -> Plan:
    """Set cover from the dark end; what no exposure shows is skipped and listed."""
    waiting = [_Open(target, target.dark, _useful(target, exposures, snr)) for target in targets]
    missed: list[Shortfall] = []
    chosen: set[int] = set()
    while True:
        for one in waiting:
            while one.reach < math.inf and one.next() is None:
                missed.append(_skip(one))
        needs = [need for one in waiting if one.reach < math.inf and (need := one.next())]
        if not needs:
            break
        # The target that needs the longest exposure cannot do with less; more would reach less far up.
        index = max(need[0] for need in needs)
        chosen.add(index)
        for one in waiting:
            for number, low, high in one.useful:
                if number == index and low <= one.reach <= high:
                    one.reach = math.inf if high >= one.target.bright else high
    if not chosen:  # nothing is shown as wanted: the most light that does not clip is the best there is
        fit = [
            index
            for index, exposure in enumerate(exposures)
            if all(target.tones.brightest(exposure) >= target.bright for target in targets)
        ]
        chosen.add(max(fit, default=0))
    missed = [_unbounded(one, targets) for one in missed]
    missed += _unknown(targets, missed)
    return Plan(tuple(exposures[index] for index in sorted(chosen)), tuple(missed))


def _useful(target: Target, exposures: Sequence[Exposure], snr: float) -> list[tuple[int, float, float]]:
    """What each exposure is good for; CaptureError if nowhere: even next to white the SNR is too low."""
    tones, trusted = target.tones, 2.0**SLACK
    ends = [
        (index, tones.darkest(snr, exposure) * trusted, tones.brightest(exposure) / trusted)
        for index, exposure in enumerate(exposures)
    ]
    useful = [one for one in ends if one[1] < one[2]]
    if not useful:
        most = max(tones.snr(high / trusted, exposures[index]) for index, _, high in ends)
        raise CaptureError(
            f"{snr:g} dB are out of the reach of {target.camera}, whose sensor gives {most:.1f} dB "
            "where it is nearly full: ask for less with --snr."
        )
    return useful


def _skip(one: _Open) -> Shortfall:
    """Go on where the next exposure begins to be good, or give the rest up."""
    start, bright, name = one.reach, one.target.bright, str(one.target)
    further = min((low for _, low, _ in one.useful if low > start), default=None)
    one.reach = further if further is not None and further <= bright else math.inf
    if further is None:
        return Shortfall(name, "bright", math.log2(bright / max(high for _, _, high in one.useful)))
    return Shortfall(name, "dark" if start == one.target.dark else "middle", math.log2(further / start))


def _unbounded(one: Shortfall, targets: Sequence[Target]) -> Shortfall:
    """A shortfall at an end that the meter did not find is at least as large."""
    target = next(target for target in targets if str(target) == one.target)
    endless = {"dark": not target.no_darker, "middle": False, "bright": not target.no_brighter}
    return replace(one, at_least=endless[one.part])


def _unknown(targets: Sequence[Target], missed: Sequence[Shortfall]) -> list[Shortfall]:
    """An end that the meter did not find is a shortfall even where the plan reaches all that is known."""
    told = {(one.target, one.part) for one in missed}
    ends: list[Shortfall] = []
    for target in targets:
        if not target.no_darker and (str(target), "dark") not in told:
            ends.append(Shortfall(str(target), "dark", 0.0, at_least=True))
        if not target.no_brighter and (str(target), "bright") not in told:
            ends.append(Shortfall(str(target), "bright", 0.0, at_least=True))
    return ends
