"""Arguments and results of `rasterize`, and its counts for density control."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import torch

from recon.splat.camera import SplatCamera
from recon.splat.limits import Limits

_CPU = torch.device("cpu")

Counts = Callable[[], tuple[int, int, int]]


@dataclass(frozen=True)
class Render:
    """One rendered view."""

    image: torch.Tensor
    """[H, W, C], linear light in the units of the colours, differentiable."""
    alpha: torch.Tensor
    """[H, W], 1 - transmittance, differentiable."""
    counts: Counts
    """Returns `culled`, `visible` and `pairs`. On a GPU they are summed up when asked for, which waits for
    all that is under way."""
    ln_depth: torch.Tensor | None = None
    """[H, W], the sum of weights times ln depth of the Gaussians' centres, differentiable; over alpha it is
    the expected one. None unless requested.
    """

    @property
    def culled(self) -> int:
        """Gaussians left out because a value was not finite, or the shape degenerate."""
        return self.counts()[0]

    @property
    def visible(self) -> int:
        """Gaussians that touch a pixel."""
        return self.counts()[1]

    @property
    def pairs(self) -> int:
        """Evaluated pixel-Gaussian pairs (the unit of cost)."""
        return self.counts()[2]


@dataclass
class SplatStats:
    """Per-Gaussian counts for density control, added to by every backward pass.

    Make one for n Gaussians, on their device, and pass it to every `rasterize` of an interval.
    """

    count: int
    device: torch.device = _CPU
    tension: torch.Tensor = field(init=False)
    """float64 [n] sum over renders of how hard pixels pull it both ways, by which it blurs what differs:
    of s = alpha d loss / d alpha at a pixel, sqrt((sum |s|)^2 - (sum s)^2), over sigma, its widest standard
    deviation in an image that is 2 wide or high, where it is longer. Two Gaussians could follow both sides.
    AbsGS (Ye et al., arXiv 2404.10484) has the sums of |s| |C^-1 d|, in which pixels that agree count too,
    and they are where all of a view is too bright: its exposure or vignetting is wrong there, no texture
    missing."""
    radius: torch.Tensor = field(init=False)
    """float32 [n] largest three-sigma radius over renders, px (blur included)."""
    weight: torch.Tensor = field(init=False)
    """float32 [n] largest blending weight alpha * transmittance over the pixels of all renders; 0 where it
    touched none."""

    def __post_init__(self) -> None:
        self.tension = torch.zeros(self.count, dtype=torch.float64, device=self.device)
        self.radius = torch.zeros(self.count, device=self.device)
        self.weight = torch.zeros(self.count, device=self.device)

    def add(
        self, camera: SplatCamera, radius: torch.Tensor, pull: torch.Tensor, weight: torch.Tensor
    ) -> None:
        """Count one render: three-sigma radii, px, pulls both ways and largest weights, [n].

        Of a Gaussian without weight the others mean nothing.
        """
        touched = weight > 0
        side = 1.5 * max(camera.width, camera.height)
        self.tension += torch.where(touched, side * pull / radius, 0.0)
        torch.maximum(self.radius, torch.where(touched, radius, 0.0), out=self.radius)
        torch.maximum(self.weight, torch.where(touched, weight, 0.0), out=self.weight)


class RasterInputs(NamedTuple):
    """Inputs of every implementation: the arguments of `rasterize`, checked.

    view: the camera's numbers where they are to be differentiated (see `recon.splat.corrected_camera`).
    """

    means: torch.Tensor
    quats: torch.Tensor
    scales: torch.Tensor
    opacities: torch.Tensor
    colours: torch.Tensor
    camera: SplatCamera
    background: torch.Tensor | None
    limits: Limits
    stats: SplatStats | None
    view: torch.Tensor | None = None

    @property
    def tensors(self) -> tuple[torch.Tensor, ...]:
        """Means, quaternions, scales, opacities, colours and the background."""
        back = self.means.new_zeros(self.colours.shape[1]) if self.background is None else self.background
        return (*self[:5], back)

    @property
    def keep(self) -> bool:
        """True if any of the tensors requires a gradient."""
        wanted = (*self.tensors, *([] if self.view is None else [self.view]))
        return torch.is_grad_enabled() and any(tensor.requires_grad for tensor in wanted)


@dataclass
class RenderCall:
    """Parameters of the kernels besides tensors, and their counts."""

    camera: SplatCamera
    limits: Limits
    stats: SplatStats | None
    keep: bool
    counts: Counts = lambda: (0, 0, 0)

    @classmethod
    def of(cls, inputs: RasterInputs) -> Self:
        """A call that has found out nothing yet."""
        return cls(inputs.camera, inputs.limits, inputs.stats, inputs.keep)
