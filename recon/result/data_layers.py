"""Layers of data beside the light of a scene: how far, which way, how solid, and how well known.

Depth is the median: the distance at which half of the light that comes from behind is stopped. The mean,
which 3DGS draws as easily, lies between the foreground and the background wherever both share a pixel, at a
place where there is nothing.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from imaging.arrays import Array32
from imaging.progress import Progress, unreported
from recon.result.layer_names import Layer
from recon.result.trust import photographs_that_saw
from recon.scene.gaussians import Shapes, drawn_values
from recon.scene.sampling import away_from
from recon.splat import SplatCamera

if TYPE_CHECKING:
    from recon.result.scene import Scene

from recon.splat import Limits
from recon.splat.torch_threads import torch_on_one_thread

_FAINT = 1e-4
"""Opacity of a pixel below which its Gaussians do not define a surface."""


@dataclass(frozen=True, eq=False)
class DataLayers:
    """Layers of a scene, of any camera, whose pose is in the world of the calibration.

    progress: called while `trust` reads the views of the scene, once, at its first use.
    """

    scene: "Scene"
    progress: Progress = field(default=unreported, repr=False)

    def layer(self, name: Layer, camera: SplatCamera) -> Array32:
        """A layer by name, float32 [H, W], of normals [H, W, 3]."""
        plane: Array32 = getattr(self, name)(camera)
        return plane

    def depth(self, camera: SplatCamera) -> Array32:
        """Along the axis of the camera, in units of the calibration, [H, W].

        Infinite where more than half of the light comes from behind all Gaussians.
        """
        placed = self._placed(camera)
        depth = median_depth(self._shapes(placed), placed, self.scene.renderer.limits)
        return np.asarray(depth * np.float32(self.scene.record.world.unit))

    def alpha(self, camera: SplatCamera) -> Array32:
        """Return how much of each pixel's light comes from the Gaussians, 0..1, [H, W]."""
        return np.asarray(self.scene.covered(self._placed(camera)).numpy())

    def normal(self, camera: SplatCamera) -> Array32:
        """Unit vectors in world axes, towards the camera, [H, W, 3]; zeros where there is no surface.

        Those of the Gaussians, which are their shortest axes, each as much as it is flatter than long.
        """
        placed = self._placed(camera)
        means, quats, scales, _ = shapes = self._shapes(placed)
        axes = _shortest_axes(quats, scales)
        towards = -(axes * away_from(means, placed)).sum(1, keepdim=True).sign()
        drawn, alpha = self._drawn(shapes, axes * towards, placed)
        return np.asarray(torch.where(alpha > _FAINT, normalize(drawn, dim=2), 0.0).numpy())

    def trust(self, camera: SplatCamera) -> Array32:
        """Number of views, as `photographs_that_saw` counts them, behind each pixel, [H, W].

        The mean of the Gaussians at the pixel, weighted by their contributions; 0 without any.
        """
        placed = self._placed(camera)
        drawn, alpha = self._drawn(self._shapes(placed), self.photographs[:, None], placed)
        return np.asarray(torch.where(alpha > _FAINT, drawn / alpha.clamp_min(_FAINT), 0.0)[..., 0].numpy())

    @cached_property
    def photographs(self) -> Tensor:
        """Number of views that photographed each Gaussian, float32 [N]."""
        return photographs_that_saw(self.scene, self.progress)

    def _placed(self, camera: SplatCamera) -> SplatCamera:
        return self.scene.record.world.camera(camera)

    def _shapes(self, placed: SplatCamera) -> Shapes:
        with torch.no_grad():
            return self.scene.renderer.shapes(self.scene.gaussians, placed)

    def _drawn(self, shapes: Shapes, values: Tensor, placed: SplatCamera) -> tuple[Tensor, Tensor]:
        """Values [N, C] blended as light is, [H, W, C], and the opacity [H, W, 1]."""
        with torch.no_grad():
            render = drawn_values(shapes, values, placed, self.scene.renderer.limits)
        return render.image, render.alpha[..., None]


def _shortest_axes(quats: Tensor, scales: Tensor) -> Tensor:
    """[N, 3] the shortest axis of each Gaussian, as long as 1 less shortest over middle scale."""
    quats = quats / quats.abs().amax(dim=1, keepdim=True).clamp_min(1e-30)
    quats = normalize(quats, dim=1)
    ordered, place = scales.sort(dim=1)
    flatness = 1 - ordered[:, :1] / ordered[:, 1:2].clamp_min(1e-30)
    axis = torch.nn.functional.one_hot(place[:, 0], 3).to(quats)
    w, turn = quats[:, :1], quats[:, 1:]
    twice = 2 * torch.linalg.cross(turn, axis)
    turned: Tensor = axis + w * twice + torch.linalg.cross(turn, twice)
    return turned * flatness


SLABS = 32
FEWEST = 128
"""Gaussians of a slab, at least."""
HALF = 0.5


def median_depth(shapes: Shapes, camera: SplatCamera, limits: Limits) -> Array32:
    """Depth along the axis, float32 [H, W], in the unit of the means; infinite where half is never stopped.

    Slab after slab is drawn, nearest first: blending is in order of depth, so that what slabs let through
    multiplies. Each Gaussian is drawn once, and the first slab at which less than half is left holds the
    surface. The depth is the mean of its Gaussians at the pixel, by what they add to it.
    """
    motion = torch.from_numpy(camera.cam_from_world).to(shapes.means)
    depth = shapes.means @ motion[2, :3] + motion[2, 3]
    order = torch.argsort(depth, stable=True)
    order = order[(depth[order] >= limits.near) & torch.isfinite(depth[order])]
    transmittance = np.ones((camera.height, camera.width), np.float32)
    median = np.full_like(transmittance, np.inf)
    size = max(FEWEST, -(-len(order) // SLABS))
    for first in range(0, len(order), size):
        rows = order[first : first + size]
        with torch.no_grad(), torch_on_one_thread():
            render = drawn_values(shapes.rows(rows), depth[rows, None], camera, limits)
        alpha, sums = render.alpha.numpy(), render.image[..., 0].numpy()
        open_before = transmittance > HALF
        transmittance *= 1 - alpha
        here = open_before & (transmittance <= HALF)
        median[here] = sums[here] / alpha[here]
        if not (transmittance > HALF).any():
            break
    return median
