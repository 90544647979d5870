"""Light from far away: radiance by direction alone, attenuated by the Gaussians before it.

A horizon is no place for a Gaussian: an object many times farther than the cameras lie apart looks the same
from all of them, and Gaussians that represent it anywhere nearer are wrong in every other view. Environment
maps: Blinn and Newell 1976.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import grid_sample, pad

from imaging.arrays import Array
from recon.data.geometry import rays
from recon.scene.appearance import Rate
from recon.splat import SplatCamera

NAME = "environment"
RATE = Rate(0.03, 0.003)
"""Learning rate of ln radiance: that of the luminance of Gaussians."""
KEPT_LENSES = 8
"""Lenses whose rays are kept: 12 bytes a pixel each."""


@dataclass(eq=False)
class Environment:
    """A map of latitude and longitude in the layout of OpenEXR.

    ln_light [3, rows, 2 * rows]: natural log of linear radiance in scene units, float32 or float64.
    axes [3, 3]: rows are unit vectors in scene axes, of longitude 90 degrees, of latitude 90 degrees (the
    uppermost row), and of the middle of the map. Longitude falls from 180 degrees at the left to -180.
    """

    ln_light: Tensor
    axes: Array

    @classmethod
    def stored(cls, tensors: dict[str, Tensor]) -> "Environment | None":
        """Return the environment in a checkpoint's `tensors`, or None."""
        return cls(tensors["ln_light"], tensors["axes"].numpy()) if tensors else None

    def tensors(self) -> dict[str, Tensor]:
        """Return what a checkpoint holds of it."""
        return {"ln_light": self.ln_light, "axes": torch.from_numpy(self.axes)}

    def to(self, device: torch.device) -> None:
        """Move the map."""
        self.ln_light = self.ln_light.to(device)

    def copied(self) -> "Environment":
        """Another that starts as this one is."""
        return Environment(self.ln_light.detach().clone(), self.axes)

    def behind(self, image: Tensor, alpha: Tensor, camera: SplatCamera) -> Tensor:
        """A render [H, W, 3] of opacity [H, W], this behind it; differentiable in all but the camera."""
        return image + (1 - alpha)[..., None] * self.render(camera)

    def render(self, camera: SplatCamera) -> Tensor:
        """Return what a camera in scene coordinates would see of it alone, [H, W, 3]."""
        turn = torch.from_numpy(self.axes @ camera.cam_from_world[:3, :3].T)
        turn = turn.to(self.ln_light, non_blocking=True)
        lens = camera.lens, camera.width, camera.height, camera.fisheye
        return self.light(_rays(*lens, turn.dtype, turn.device) @ turn.T)

    def light(self, directions: Tensor) -> Tensor:
        """Radiance [..., 3] from directions [..., 3] of any length, along `axes`; bilinear."""
        rows = self.ln_light.shape[1]
        x, y, z = directions.reshape(-1, 3).unbind(1)
        right = 0.5 - torch.atan2(x, z) / (2 * math.pi)
        down = 0.5 - torch.atan2(y, torch.hypot(x, z)) / math.pi
        # A column of the other end on each side: longitude has none.
        across = 2 * (2 * rows * right + 1) / (2 * rows + 2) - 1
        places = torch.stack([across, 2 * down - 1], 1)[None, None]
        map_light = pad(self.ln_light.exp()[None], (1, 1, 0, 0), mode="circular")
        sampled = grid_sample(map_light, places, padding_mode="border", align_corners=False)
        return sampled[0, :, 0].T.reshape(directions.shape)

    def directions(self) -> Array:
        """Unit vectors [rows, 2 * rows, 3] of the middles of the texels, in scene axes."""
        return texels(self.ln_light.shape[1]) @ self.axes


def texels(rows: int) -> Array:
    """Unit vectors [rows, 2 * rows, 3] of the middles of texels, along the axes of a map."""
    latitude = np.pi * (0.5 - (np.arange(rows) + 0.5) / rows)[:, None]
    longitude = np.pi * (1 - (np.arange(2 * rows) + 0.5) / rows)[None]
    up = np.broadcast_to(np.sin(latitude), (rows, 2 * rows))
    return np.stack([np.sin(longitude) * np.cos(latitude), up, np.cos(longitude) * np.cos(latitude)], -1)


@functools.lru_cache(maxsize=KEPT_LENSES)
def _rays(
    lens: tuple[float, ...], width: int, height: int, fisheye: bool, dtype: torch.dtype, device: torch.device
) -> Tensor:
    """Directions [H, W, 3] through the middles of pixels, in the camera's axes."""
    names = SplatCamera(np.eye(4), 1.0, 1.0, 0.0, 0.0, width, height, fisheye=fisheye)
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return torch.from_numpy(rays(names.with_lens(lens), np.stack([x, y], -1))).to(device, dtype)
