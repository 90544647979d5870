# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Kernel of the pixel spacings at which cameras see Gaussians: many cameras times many Gaussians, on all
cores.
"""

import math
from collections.abc import Sequence

import numpy as np

from imaging.arrays import Array32
from imaging.compute.jit import kernel
from imaging.compute.threads import share, take_number
from imaging.optics import lens as optics
from recon.splat import SplatCamera

_BOUNDS, _LEAST_COSINE, _FOCAL, _FISHEYE = 12, 16, 17, 18
"""Offsets of a camera's numbers behind its rotation (9) and translation (3)."""
_TASK = 4096


def spacing_range(means: Array32, cameras: Sequence[SplatCamera]) -> tuple[Array32, Array32]:
    """Least and most spacing of pixels [N] at points [N, 3], of the cameras in whose picture they are.

    As `recon.scene.sampling.spacing_of` has it; 0 and infinity of what none sees.
    """
    least, most = np.zeros(len(means), np.float32), np.full(len(means), np.inf, np.float32)
    if len(means) and cameras:
        numbers = np.array([_numbers(camera) for camera in cameras])
        points = np.ascontiguousarray(means)
        share(_range, 0.01 * len(means) * len(cameras), points, numbers, least, most)
    return least, most


def _numbers(camera: SplatCamera) -> list[float]:
    """Numbers of a camera for the kernel: see _BOUNDS."""
    motion = np.asarray(camera.cam_from_world, np.float64)
    cosine = -1.0
    if camera.fisheye:
        corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * (camera.width, camera.height)
        bent = (corners - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
        farthest = np.linalg.norm(bent, axis=1).max(keepdims=True)
        cosine = math.cos(float(optics.fisheye_angle(farthest, camera.lens[4:])[0]))
    focal = math.sqrt(camera.fx * camera.fy)
    bounds = camera.tangent_bounds(0.0)
    return [*motion[:3, :3].ravel(), *motion[:3, 3], *bounds, cosine, focal, float(camera.fisheye)]


@kernel
def _range(counter, means, cameras, least, most):
    task = take_number(counter)
    while task * _TASK < len(means):
        for i in range(task * _TASK, min((task + 1) * _TASK, len(means))):
            low, high = np.inf, 0.0
            for camera in cameras:
                z = camera[6] * means[i, 0] + camera[7] * means[i, 1] + camera[8] * means[i, 2] + camera[11]
                if not z > 0.0:
                    continue
                x = camera[0] * means[i, 0] + camera[1] * means[i, 1] + camera[2] * means[i, 2] + camera[9]
                if not camera[_BOUNDS] * z <= x <= camera[_BOUNDS + 1] * z:
                    continue
                y = camera[3] * means[i, 0] + camera[4] * means[i, 1] + camera[5] * means[i, 2] + camera[10]
                if not camera[_BOUNDS + 2] * z <= y <= camera[_BOUNDS + 3] * z:
                    continue
                distance = math.sqrt(x * x + y * y + z * z)
                cosine = z / distance
                if not cosine >= camera[_LEAST_COSINE]:
                    continue
                shrunk = cosine * math.sqrt(cosine)
                if camera[_FISHEYE] > 0.0:
                    angle = math.acos(min(cosine, 1.0))
                    shrunk = math.sqrt(math.sin(angle) / angle) if angle > 1e-6 else 1.0
                spacing = shrunk * distance / camera[_FOCAL]
                low, high = min(low, spacing), max(high, spacing)
            if high > 0.0:
                least[i], most[i] = low, high
        task = take_number(counter)
