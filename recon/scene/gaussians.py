"""The Gaussians of a scene: their parameters, and the picture that a camera takes of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from recon.scene.appearance import Appearance, Parameters, Rate
from recon.scene.environment import Environment
from recon.scene.sampling import Sampling, away_from
from recon.splat import Limits, Render, SplatCamera, SplatStats, rasterize
from recon.splat.corrected_camera import moved
from recon.splat.limits import CHANNELS_MOST

GEOMETRY = ("means", "log_scales", "quats", "opacity_logits")


@dataclass(frozen=True)
class GeometryRates:
    """Learning rates of where the Gaussians are; that of the means is in units of the scene's extent.

    Means that end at 5e-5 cost lego 0.4 dB (200 px, 2,500 iterations), at 5e-6 the gallery 0.1.
    """

    means: Rate = Rate(1e-3, 1.5e-5)
    log_scales: Rate = Rate(4e-2, 5e-3)
    quats: Rate = Rate(1e-2, 1e-3)
    opacity_logits: Rate = Rate(1e-1, 2e-2)

    def all(self, extent: float) -> dict[str, Rate]:
        """The rate of every geometric parameter, in scene coordinates."""
        return {
            "means": Rate(self.means.start * extent, self.means.end * extent),
            "log_scales": self.log_scales,
            "quats": self.quats,
            "opacity_logits": self.opacity_logits,
        }


@dataclass
class Gaussians:
    """N Gaussians, by the name of their parameters, float32, the first dimension N.

    means [N, 3] in scene coordinates; log_scales [N, 3] natural log of their unit; quats [N, 4] wxyz, any
    length; opacity_logits [N]; and what the appearance owns.
    """

    parameters: Parameters

    def __len__(self) -> int:
        return len(self.parameters["means"])

    @property
    def device(self) -> torch.device:
        """Device of the tensors."""
        return self.parameters["means"].device

    def to(self, device: torch.device) -> "Gaussians":
        """The same on a device; itself, if it is there already."""
        return Gaussians({name: value.to(device) for name, value in self.parameters.items()})

    def joined(self, others: "Gaussians") -> "Gaussians":
        """These and others of the same appearance behind them, without gradient."""
        both = {
            name: torch.cat([value.detach(), others.parameters[name]])
            for name, value in self.parameters.items()
        }
        return Gaussians(both)

    def opacities(self) -> Tensor:
        """Opacities in 0..1, [N]."""
        return torch.sigmoid(self.parameters["opacity_logits"])

    def scales(self) -> Tensor:
        """Standard deviations along the own axes, in the unit of the means, [N, 3]."""
        return self.parameters["log_scales"].exp()

    def rows(self, index: Tensor) -> Parameters:
        """A copy of some of the Gaussians: `index` int64 [M] or bool [N]."""
        return {name: value.detach()[index].clone() for name, value in self.parameters.items()}


class Shapes(NamedTuple):
    """The first arguments of `rasterize`: means [N, 3], quats [N, 4], scales [N, 3], opacities [N]."""

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor

    def rows(self, index: Tensor) -> "Shapes":
        """Some of them: `index` int64 [M] or bool [N]."""
        return Shapes(*(part[index] for part in self))


@dataclass(frozen=True)
class Renderer:
    """Drawing of Gaussians: the appearance, the cut-offs of the rasteriser, and the environment.

    environment: None: black. sampling: the distances they were trained at; None: any.
    """

    appearance: Appearance
    limits: Limits
    environment: Environment | None = None
    sampling: Sampling | None = None

    def __call__(
        self,
        gaussians: Gaussians,
        camera: SplatCamera,
        *,
        degree: int,
        stats: SplatStats | None = None,
        camera_delta: Tensor | None = None,
        depth: bool = False,
    ) -> Render:
        """Linear Rec.709 radiance in scene units, before the environment; differentiable in every parameter.

        camera_delta [14]: how far the camera is moved, as `rasterize` has it; differentiable too, but for how
        the environment and the depth change with it; on the CPU, so that a GPU is not waited for. depth:
        whether `ln_depth` is drawn, too.
        """
        place = camera if camera_delta is None else moved(camera, camera_delta.detach())[0]
        with torch.no_grad():
            away = away_from(gaussians.parameters["means"], place)
        shapes = self._shapes(gaussians, place, away)

        def drawn(colours: Tensor, stats: SplatStats | None) -> Render:
            return rasterize(*shapes, colours, camera, None, self.limits, stats, camera_delta)

        colours = self._colours(gaussians, away, degree)
        if depth:
            render = self._with_depth(drawn, colours, gaussians.parameters["means"], place, stats)
        else:
            render = drawn(colours, stats)
        if self.environment is None:
            return render
        return replace(render, image=self.environment.behind(render.image, render.alpha, place))

    def shapes(self, gaussians: Gaussians, camera: SplatCamera) -> Shapes:
        """Shapes and opacities of the Gaussians for a camera: the first arguments of `rasterize`."""
        return self._shapes(gaussians, camera, away_from(gaussians.parameters["means"], camera))

    def colours(self, gaussians: Gaussians, camera: SplatCamera, degree: int) -> Tensor:
        """Light of the Gaussians towards a camera, [N, C], scene units; differentiable in their colours."""
        return self._colours(gaussians, away_from(gaussians.parameters["means"].detach(), camera), degree)

    def _colours(self, gaussians: Gaussians, away: Tensor, degree: int) -> Tensor:
        directions = away / away.norm(dim=1, keepdim=True).clamp_min(1e-12)
        return self.appearance.colours(gaussians.parameters, directions, degree)

    def _shapes(self, gaussians: Gaussians, camera: SplatCamera, away: Tensor) -> Shapes:
        quats, scales, opacities = gaussians.parameters["quats"], gaussians.scales(), gaussians.opacities()
        if self.sampling is not None:
            blur = self.limits.blur
            scales, opacities = self.sampling.drawn(away, scales, quats, opacities, camera, blur)
        return Shapes(gaussians.parameters["means"], quats, scales, opacities)

    def _with_depth(
        self,
        drawn: Callable[[Tensor, SplatStats | None], Render],
        colours: Tensor,
        means: Tensor,
        place: SplatCamera,
        stats: SplatStats | None,
    ) -> Render:
        """A render that has `ln_depth` too: of one more channel, or where there is no room for it of its own.

        In a unit so small that no cut-off depends on it. The kernels of GPUs draw three channels.
        """
        unit = self.limits.luminance_reference or 1.0
        ahead = torch.from_numpy(place.cam_from_world[2]).to(means, non_blocking=True)
        ln_depth = unit * (means @ ahead[:3] + ahead[3]).clamp_min(self.limits.near).log()[:, None]
        if means.device.type != "cpu" or colours.shape[1] == CHANNELS_MOST:
            # As bright as the light, so that both are cut off alike.
            light = colours.detach().amax(1, keepdim=True).expand(-1, 2)
            rendered = drawn(torch.cat([ln_depth, light], 1), None)
            return replace(drawn(colours, stats), ln_depth=rendered.image[..., 0] / unit)
        render = drawn(torch.cat([colours, ln_depth], 1), stats)
        return replace(render, image=render.image[..., :-1], ln_depth=render.image[..., -1] / unit)


def drawn_values(
    shapes: Shapes, values: Tensor, camera: SplatCamera, limits: Limits, stats: SplatStats | None = None
) -> Render:
    """Values of Gaussians blended as their light is, over black.

    Brightness does not influence a Gaussian's extent: values are no light.

    Args:
        shapes: Shapes and opacities of the N Gaussians for the camera (`Renderer.shapes`).
        values: Values [N, C] of 1 to 16 channels.
        camera: View to draw, in scene coordinates.
        limits: Cut-offs, whose luminance reference is left out.
        stats: Counts that the render adds to; None: not counted.

    Returns:
        The values [H, W, C] as image, and alpha [H, W]; differentiable.

    Raises:
        InputError: Shapes, dtypes or devices do not agree.
    """
    return rasterize(*shapes, values, camera, None, replace(limits, luminance_reference=None), stats)


TAU = 0.03
"""A cut-off may change a pixel by this share of the dimmest radiance that matters: of a Gaussian's rim
that is one photo-electron or less, and a third fewer pixels to blend than at a thousandth."""


DISPLAYED = Limits(t_min=1e-4)
"""The cut-offs for display values: what they leave out of a Gaussian is no more than a step of 8 bits. With
those of light a training blends a third more pixels: sceaux, 400 px, 40,000 Gaussians, 500 iterations, two
seeds, 25.3 and 21.1 processor seconds, 19.33 and 19.39 dB.
"""


def limits_for(reference: float | None, display_values: bool = False) -> Limits:
    """The cut-offs for a scene whose dimmest radiance that matters is `reference`, in scene units, or of
    display values.
    """
    return DISPLAYED if display_values else replace(Limits(), luminance_reference=reference, tau=TAU)
