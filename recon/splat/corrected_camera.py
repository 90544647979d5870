"""A camera moved a little, differentiably: for the refinement of poses and lenses."""

from dataclasses import replace

import numpy as np
import torch

from imaging.errors import InputError
from recon.splat.camera import SplatCamera

DELTA = 14
"""Numbers of a `camera_delta`: translation 3, rotation 3, and the 8 of `SplatCamera.lens`."""
VIEW = 20
"""Numbers of a camera's view: rotation 9 (row-major), translation 3, and the 8 of `SplatCamera.lens`."""


def moved(camera: SplatCamera, delta: torch.Tensor) -> tuple[SplatCamera, torch.Tensor]:
    """`camera` moved by `delta` [14], and its view: float64 [20] on the CPU, differentiable in delta.

    delta: a motion in camera axes, applied after `cam_from_world`: the exponential of the twist of
    translation (3, world units) and rotation (3, rotation vector, radians); then what is added to fx,
    fy, cx, cy (pixels) and k1, k2, p1, p2, of a fisheye k1, k2, k3, k4. Zeros leave the camera as
    it is. InputError for values that are not finite.
    """
    change = delta.to("cpu", torch.float64)
    if not torch.isfinite(change).all():
        raise InputError("camera_delta is not finite")
    motion = torch.from_numpy(np.array(camera.cam_from_world, np.float64))
    motion = torch.linalg.matrix_exp(_twist(change[:6])) @ motion
    lens = change[6:] + torch.tensor(camera.lens, dtype=torch.float64)
    view = torch.cat([motion[:3, :3].reshape(9), motion[:3, 3], lens])
    place = replace(camera, cam_from_world=motion.detach().numpy())
    return place.with_lens(lens.tolist()), view


def view_of(camera: SplatCamera) -> torch.Tensor:
    """The camera's view, float64 [20], constant."""
    motion = np.asarray(camera.cam_from_world, np.float64)
    return torch.from_numpy(np.concatenate([motion[:3, :3].ravel(), motion[:3, 3], camera.lens]))


def _twist(motion: torch.Tensor) -> torch.Tensor:
    """The matrix [4, 4] of a twist [6], translation first."""
    x, y, z, a, b, c = motion.unbind()
    zero = torch.zeros_like(x)
    rows = [[zero, -c, b, x], [c, zero, -a, y], [-b, a, zero, z], [zero] * 4]
    return torch.stack([torch.stack(row) for row in rows])
