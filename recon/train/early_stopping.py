"""Early end of a training: quality stands still, is reached, or time runs out.

Each is a `recon.train.training.Steer`. Stopping in the middle of a schedule would leave the scene at high
learning rates, so the end is always a cool-down: the rest of the schedule in a few iterations.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from recon.train.densification import DensityRules
from recon.train.half_size import UNTIL
from recon.train.schedule import Schedule
from recon.train.training import Training

COOL_DOWN = 0.2
"""Share of what is left of a schedule that a cool-down takes: near its end rates are low already."""
BEGIN = 0.3
"""Share of the schedule before which early stop judges nothing."""
AIM, EARLY, LATE = 0.97, 0.955, 0.99
"""Shares of the time: that a schedule is fitted to, and those outside which its end is early or late."""
EVERY = 0.02
"""Share of the time between two looks at the speed."""
PATIENCE = 0.3
"""Tolerated error of the end, as a share of the time that is left: the first iterations are slow, and a
training shortened for them would not be the requested one.
"""


def cooling(training: Training) -> int | None:
    """Iterations of a cool-down from here; None if what is left is no longer than one."""
    schedule = training.schedule
    assert schedule is not None
    rest = max(1, round(COOL_DOWN * (1 - schedule.progress(training.iteration)) * schedule.planned))
    return rest if rest < schedule.total - training.iteration else None


@dataclass(frozen=True)
class EarlyStop:
    """Cool down when the rest of the schedule would bring little.

    The gain is the slope of a straight line through the last `moments` points of the live curve, in dB per
    planned training, not per second: so the same seed stops at the same iteration on any machine.
    """

    least: float = 0.3
    """dB that the rest has to promise at the present slope. The cool-down recovers most of this gain. For
    schedules already capped by `enough()` (recon.decide.cost.prediction), a threshold of 1 dB cost 0.1 dB or
    more."""
    moments: int = 5
    halved: bool = False
    """Views begin at half size, at which quality stands still before what full size has to show: no moment
    up to their full size is judged by."""

    def __call__(self, training: Training) -> int | None:
        """Decide at a point of the curve only."""
        schedule, curve = training.schedule, training.curve
        if schedule is None or training.ending:
            return None
        since = UNTIL if self.halved else 0.0
        if sum(schedule.progress(moment.iteration) > since for moment in curve) < self.moments:
            return None
        if curve[-1].iteration != training.iteration or schedule.progress(training.iteration) < BEGIN:
            return None
        promised = self.slope(training) * (1 - schedule.progress(training.iteration))
        rest = cooling(training) if promised < self.least else None
        if rest is not None:
            training.ending = "early stop"
        return rest

    def slope(self, training: Training) -> float:
        """dB per planned training, over the last moments."""
        assert training.schedule is not None
        last = training.curve[-self.moments :]
        places = [training.schedule.progress(moment.iteration) for moment in last]
        return float(np.polyfit(places, [moment.db for moment in last], 1)[0])


@dataclass(frozen=True)
class Goal:
    """Cool down when the held-out views are as good as was asked for."""

    db: float

    def __call__(self, training: Training) -> int | None:
        """Decide at a point of the curve only."""
        curve = training.curve
        if training.ending or not curve or curve[-1].iteration != training.iteration:
            return None
        rest = cooling(training) if curve[-1].db >= self.db else None
        if rest is not None:
            training.ending = "goal"
        return rest


@dataclass
class Deadline:
    """Steer that fits the rest of the schedule into the rest of the time, again and again.

    The speed of the last iterations predicts the end of the training. If that is late, or early although the
    schedule has been shortened for time, the rest is fitted anew. The result depends on the machine;
    `training.schedule` holds it.
    """

    seconds: float
    longest: int
    """Iterations of the whole schedule if there is time enough."""
    cap: int
    """Gaussians at the end."""
    slowdown: float = 1.0
    """Times that an iteration takes once views are looked at in full size, of one before."""
    _since: tuple[int, float] | None = field(default=None, repr=False)

    def __call__(self, training: Training) -> int | None:
        """Now and then: every fiftieth part of the time, and at each iteration when it is nearly over."""
        spent, schedule = training.seconds + training.measuring, training.schedule
        assert schedule is not None
        # What iterations at half the size took is no measure of the others.
        if self._since is None or self._turned_full(schedule, training.iteration):
            self._since = (training.iteration, spent)
            return None
        made, taken = training.iteration - self._since[0], spent - self._since[1]
        rest = schedule.total - training.iteration
        if taken < EVERY * self.seconds and spent < LATE * self.seconds:
            return None
        self._since = (training.iteration, spent)
        pace = max(taken / made, 1e-9) * self._growth(training)
        end = spent + rest * pace
        latest = LATE * self.seconds + PATIENCE * max(self.seconds - spent, 0.0)
        if EARLY * self.seconds <= end <= latest:
            return None
        fitting = max(1, math.floor((AIM * self.seconds - spent) / pace))
        if end > latest:
            return min(fitting, rest)
        if training.ending:
            return None
        most = round((1 - schedule.progress(training.iteration)) * self.longest)
        return min(fitting, most) if min(fitting, most) > rest else None

    def _turned_full(self, schedule: Schedule, iteration: int) -> bool:
        """Return whether views have come to their full size since the last look."""
        assert self._since is not None
        before = schedule.progress(self._since[0])
        return self.slowdown > 1 and before < UNTIL <= schedule.progress(iteration)

    def _growth(self, training: Training) -> float:
        """Slowdown of the rest, as the number of Gaussians grows, half the cost being theirs, and as views
        come to their full size.
        """
        assert training.schedule is not None
        now, progress = len(training.gaussians), training.schedule.progress(training.iteration)
        growing = max(DensityRules(self.cap).end - progress, 0) / max(1 - progress, 1e-9)
        mean = self.cap - 0.5 * growing * (self.cap - now)
        growth = max((self.cap + mean) / (self.cap + now), 1.0)
        if progress >= UNTIL:
            return growth
        return growth * (UNTIL - progress + self.slowdown * (1 - UNTIL)) / (1 - progress)
