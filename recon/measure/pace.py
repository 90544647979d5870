"""Parts of an evaluation that there is time for, evenly chosen."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from recon.data.dataset import View
from recon.result.opened import Opened

Clock = Callable[[], float]


@dataclass
class Pace:
    """Takes as many of `count` turns as there is time for, evenly spread, by how long each is expected to
    take.

    until: reading of `clock`. turns: that there were; taken: of these.
    """

    count: int
    until: float
    clock: Clock = time.monotonic
    turns: int = field(default=0, init=False)
    taken: int = field(default=0, init=False)
    _owed: float = field(default=0.5, init=False)

    def takes(self, seconds: float) -> bool:
        """Return whether the next turn, of about that many seconds, is taken; the first one is at 0."""
        rest = self.count - self.turns
        self.turns += 1
        room = max(self.until - self.clock(), 0.0)
        share = 1.0 if room >= rest * seconds else math.floor(room / seconds) / rest
        self._owed += share
        if self._owed < 1:
            return False
        self._owed -= 1
        self.taken += 1
        return True


def views_in_time(opened: Opened, until: float, measure: Callable[[Opened], object]) -> Opened:
    """The scene with as many of its reported views as there is time to measure, evenly chosen, at least one.

    until: reading of the monotonic clock. The first view says how long `measure` takes: again where it
    would be too long, since what is called for the first time has to be loaded.
    """
    views = opened.dataset.reported
    fits = len(views)
    if until == math.inf or fits < 2:
        return opened
    for _ in range(2):
        began = time.monotonic()
        measure(_of(opened, views[:1]))
        fits = math.floor((until - time.monotonic()) / max(time.monotonic() - began, 1e-6))
        if fits >= len(views):
            return opened
    fits = max(fits, 1)
    return _of(opened, [views[(2 * turn + 1) * len(views) // (2 * fits)] for turn in range(fits)])


def _of(opened: Opened, held_out: Sequence[View]) -> Opened:
    """The scene with those of its held-out views alone."""
    return replace(opened, dataset=replace(opened.dataset, held_out=tuple(held_out)))
