"""Half the size for the first half of a training, where a view has many pixels for each Gaussian.

A coarse scene shows no detail, and pixels are most of the time of an iteration. One octave for half of the
schedule (bench/results/half_size.md), where DashGaussian (Chen et al., arXiv 2503.18402) goes up in small
steps by the frequencies of the pictures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean

from recon.data.dataset import View
from recon.data.downsampling import Falloffs, narrower
from recon.data.resident import pixels_of

UNTIL = 0.5
"""Share of the schedule at which views come to their full size."""
PIXELS, FEWEST = 4.0, 100_000
"""Pixels of a view for each Gaussian at least, so that half of it has one for each; and pixels at all, below
which their share of the time is small.
"""


def begins_halved(pixels: float, gaussians: int) -> bool:
    """Return whether a training of views of that many pixels, to that many Gaussians, begins at half size."""
    return pixels >= max(PIXELS * gaussians, FEWEST)


def halves(views: Sequence[View], gaussians: int) -> bool:
    """Return whether a training on these views does."""
    return begins_halved(fmean(map(pixels_of, views)), gaussians)


@dataclass
class HalfSize:
    """Training views at the size in which they are looked at.

    Halved ones are made once, and let go when their time is over; of views whose shots memory does not hold
    they are made at each look, so that the scene is the same.
    """

    on: bool
    _views: dict[str, View] = field(default_factory=dict)
    _falloffs: Falloffs = field(default_factory=dict)

    def of(self, view: View, done: float) -> View:
        """Return the view as it is looked at at this share of the schedule, 0..1."""
        if not self.on or done >= UNTIL:
            self._views.clear()
            return view
        if view.name in self._views:
            return self._views[view.name]
        small = narrower(view, view.lens.width // 2, self._falloffs)
        if view.held:
            self._views[view.name] = small
            return small
        return replace(small, shots=tuple(shot.showing(held=False) for shot in small.shots))
