"""A budget of time, from Enter to the end, and what of a reconstruction it has room for.

What does not fit is left out in this order, with a message as soon as that is clear: the page with its
evaluation, depths of some of the views, trials of what the scene needs, iterations, and last the width and
the number of Gaussians, which become those of a smaller preset.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from imaging.errors import InputError

SAVING, PAGE = 5.0, 30.0
"""Seconds that files and display colours take, over those of the first look at the light of the training
views; and that evaluation and page take for each held-out view, over those of the look at one. On the demo
both together take 14 s. Other work on the machine slows that look down as it will them."""
MOST_OF_PAGE, MOST_OF_START = 0.3, 0.4
"""Share of the time that is left which the page, and the depths of the views, may take."""


class TooShort(InputError):
    """A time has no room for a training of this size; it says which would do."""


@dataclass
class Countdown:
    """Remaining time of `seconds` that began at `began`, a reading of `clock`.

    page: whether the scene is evaluated and reported after it is trained; made False where that does not
    fit. reserve: seconds that are kept for what follows training. say: is given a line on what is left out.
    """

    seconds: float
    began: float
    page: bool = False
    clock: Callable[[], float] = time.monotonic
    say: Callable[[str], None] = lambda line: None
    reserve: float = field(default=0.0, init=False)

    def remaining(self) -> float:
        """Seconds until training has to be over."""
        return self.seconds - (self.clock() - self.began) - self.reserve

    def plan(self, look: float, train: int, held_out: int) -> None:
        """Set time aside for what follows, by the seconds that the first look at `train` views took."""
        page = PAGE * look * held_out / max(train, 1)
        self.reserve = SAVING * look
        if self.page and page > MOST_OF_PAGE * self.remaining():
            self.page = False
            self.say(f"{self.seconds:g} s leave no room for evaluation and page: `rig evaluate` makes them.")
        if self.page:
            self.reserve += page

    def start_over(self) -> Callable[[], bool]:
        """Return whether the share of the time that depths of views may take is used up."""
        end = self.clock() + MOST_OF_START * max(self.remaining(), 0.0)
        return lambda: self.clock() >= end

    def require(self, training: float, fewest: int) -> None:
        """TooShort, with the time that would do, where the `training` seconds of the fewest do not fit."""
        available = self.remaining()
        if training <= available:
            return
        needed = math.ceil((self.seconds - available + training) / 5) * 5
        raise TooShort(
            f"{self.seconds:g} s are too short for this scene on this machine, busy as it is: start, saving "
            f"and the fewest iterations, {fewest}, take {needed} s at least: give --budget {needed}s or more."
        )
