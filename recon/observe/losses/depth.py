"""Difference of a render's depth from the depth measured beside a photograph.

Depth as supervision: Deng et al., arXiv 2107.02791, of how density is spread along rays. Here of the expected
logarithm of depth alone, so that near and far count alike, and robust, so that the rims of what a scanner
sees do not pull.
"""

from dataclasses import dataclass, field

import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from recon.data.dataset import View
from recon.observe.targets import Targets
from recon.splat import Render

SURE = 0.02
"""Threshold in ln depth: smaller differences count by their square, as noise of scanners does."""
THERE = 0.5
"""Alpha below which nothing has been drawn yet whose depth could be wrong."""


@dataclass(frozen=True)
class _Measured:
    """Measured depth of a view, [H, W]: ln of its depth in scene coordinates, and where that is known,
    bool.
    """

    ln_depth: Tensor
    known: Tensor

    @classmethod
    def of(cls, view: View) -> "_Measured":
        """Return what was measured beside the photographs of a view."""
        assert view.depth is not None
        depth = torch.from_numpy(view.depth.read(view))
        known = depth > 0
        return cls(torch.where(known, depth, 1.0).log(), known)


@dataclass
class MeasuredDepth:
    """The depth of views, and how a render compares with it."""

    _targets: Targets[_Measured] = field(default_factory=Targets, repr=False)

    def difference(self, render: Render, view: View) -> Tensor | float:
        """Mean over the pixels of Huber's loss of ln depth, whose slope is 1 far out; 0 without a map.

        render: with `ln_depth`. Pixels count whose depth is known and where the render has something.
        """
        if view.depth is None or render.ln_depth is None:
            return 0.0
        goal = self._targets.of(view, lambda: _Measured.of(view), render.alpha.device)
        there = goal.known & (render.alpha.detach() > THERE)
        expected = render.ln_depth / torch.where(there, render.alpha, 1.0)
        away = torch.where(there, expected - goal.ln_depth.to(expected.dtype), 0.0)
        return huber_loss(away, torch.zeros_like(away), delta=SURE) / SURE
