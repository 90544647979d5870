"""Choice among brackets of equal length: the one with the best signal where exposures hand over.

Just above the light at which a longer exposure clips, the next shorter one is on its own: there the
bracket is noisiest. On a list in which a longer exposure reaches further down and less far up, what a
bracket misses lies below its longest, above its shortest or between two neighbours. Whether it shows
enough, how good its worst hand-over is and how long it takes therefore follow from its neighbours
alone, and the best bracket is a path that dynamic programming finds exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from capture.bracket.code_noise import CodeNoise
from capture.bracket.raw_noise import RawNoise
from imaging.arrays import Array, Mask
from imaging.optics.exposure import Exposure


@dataclass(frozen=True)
class Reach:
    """Range of each of n exposures at one target: radiance from `low` to `high`, float64 [n].

    In ascending order of scale both descend; nothing where low > high. handed: [n, n], dB that the
    first exposure gives where the second one ends.
    """

    dark: float
    bright: float
    low: Array
    high: Array
    handed: Array

    @classmethod
    def of(
        cls,
        noise: RawNoise | CodeNoise,
        ends: tuple[float, float],
        exposures: Sequence[Exposure],
        snr: float,
        slack: float,
    ) -> Self:
        """Compute the ranges from the noise of a camera; ends: of the target; slack: stops less at either
        end.
        """
        trusted = 2.0**slack
        low = np.array([noise.darkest(snr, exposure) * trusted for exposure in exposures])
        high = np.array([noise.brightest(exposure) / trusted for exposure in exposures])
        return cls(*ends, low, high, np.array([noise.snrs(high, exposure) for exposure in exposures]))

    def misses(self) -> tuple[Mask, Mask, Mask]:
        """Shortfalls: stops above each exposure [n], below each [n], between any two [n, n]."""
        ends = np.concatenate([[self.dark, self.bright], self.low, self.high])
        ends = np.unique(ends[(ends >= self.dark) & (ends <= self.bright)])
        points = np.concatenate([ends, np.sqrt(ends[:-1] * ends[1:])])[:, None]
        points = points[((points >= self.low) & (points <= self.high)).any(axis=1)]
        above, below = points > self.high, points < self.low
        between = above[:, None, :] & below[:, :, None]
        above_any, below_any, between_any = (np.asarray(cut.any(axis=0)) for cut in (above, below, between))
        return above_any, below_any, between_any

    def worth(self) -> Array:
        """SNR in dB at the hand-over of every two exposures, [shorter, longer]; infinite without one."""
        there = (self.dark <= self.high) & (self.high < self.bright) & (self.low[:, None] <= self.high)
        return np.where(there, self.handed, np.inf)


def balance(reaches: Sequence[Reach], times: Array, count: int, most: float) -> list[int]:
    """`count` exposures that miss nothing, with the best worst hand-over, of those the quickest.

    Args:
        reaches: Range of every exposure at each target, of n exposures in ascending order of scale.
        times: Shutter times of the exposures, s, [n].
        count: Length of the bracket.
        most: Longest time of all its exposures together, s.

    Returns:
        Ascending indices of the exposures; empty if no bracket is quick enough.
    """
    shortest, longest = np.ones(len(times), bool), np.ones(len(times), bool)
    joined, worth = np.triu(np.ones((len(times),) * 2, bool), 1), np.full((len(times),) * 2, np.inf)
    for reach in reaches:
        above, below, between = reach.misses()
        shortest, longest, joined = shortest & ~above, longest & ~below, joined & ~between
        worth = np.minimum(worth, reach.worth())
    levels = np.unique(worth[joined])
    best: list[int] = []
    first, last = 0, len(levels)
    while first < last:
        middle = (first + last) // 2
        path, seconds = _quickest(shortest, longest, joined & (worth >= levels[middle]), times, count)
        if seconds <= most:
            best, first = path, middle + 1
        else:
            last = middle
    return best


def _quickest(
    shortest: Mask, longest: Mask, joined: Mask, times: Array, count: int
) -> tuple[list[int], float]:
    """The path of `count` exposures from a possible shortest to a possible longest one, and its seconds."""
    seconds = np.where(shortest, times, np.inf)
    before = []
    for _ in range(count - 1):
        ways = np.where(joined, seconds[:, None], np.inf)
        before.append(ways.argmin(axis=0))
        seconds = ways.min(axis=0) + times
    seconds = np.where(longest, seconds, np.inf)
    path = [int(seconds.argmin())]
    for step in reversed(before):
        path.insert(0, int(step[path[0]]))
    return path, float(seconds[path[-1]])
