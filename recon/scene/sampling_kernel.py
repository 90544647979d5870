# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Kernel of `Sampling.drawn`, in one pass without gradient, for pictures of a moving camera."""

import math
from collections.abc import Sequence

import numpy as np

from imaging.arrays import Array32
from imaging.compute.jit import kernel
from imaging.compute.threads import share, take_number
from recon.splat import SplatCamera

_TASK = 4096


def drawn_by_kernel(arrays: Sequence[Array32], camera: SplatCamera, blur: float) -> tuple[Array32, Array32]:
    """Scales [N, 3] and opacities [N], float32, new.

    arrays: away [N, 3], scales [N, 3], quats [N, 4], opacities [N], least [N] and most [N], contiguous, as
    `Sampling` has them.
    """
    away, scales, quats, opacities, least, most = arrays
    wide, thick = np.empty_like(scales), np.empty_like(opacities)
    axis = np.asarray(camera.cam_from_world[2, :3], np.float64)
    focal = math.sqrt(camera.fx * camera.fy)
    share(
        _drawn, 0.03 * len(away), away, scales, quats, opacities, least, most, axis, focal,
        camera.fisheye, blur, wide, thick,
    )  # fmt: skip
    return wide, thick


@kernel
def _drawn(counter, away, scales, quats, opacities, least, most, axis, focal, fisheye, blur, wide, thick):
    task = take_number(counter)
    while task * _TASK < len(away):
        for i in range(task * _TASK, min((task + 1) * _TASK, len(away))):
            x, y, z = float(away[i, 0]), float(away[i, 1]), float(away[i, 2])
            distance = max(math.sqrt(x * x + y * y + z * z), 1e-12)
            cosine = (x * axis[0] + y * axis[1] + z * axis[2]) / distance
            cosine = min(max(cosine, 0.02), 1.0)
            if fisheye:
                angle = math.acos(cosine)
                shrunk = math.sqrt(math.sin(angle) / angle) if angle > 1e-6 else 1.0
            else:
                shrunk = cosine * math.sqrt(cosine)
            spacing = shrunk * distance / focal
            for k in range(3):
                wide[i, k] = scales[i, k]
            thick[i] = opacities[i]
            finer = least[i] / spacing
            if finer > 1.0:
                added = blur * (finer * finer - 1.0) * spacing * spacing
                for k in range(3):
                    size = float(scales[i, k])
                    if size > 0.0:
                        wide[i, k] = math.sqrt(size * size + added)
            coarser = most[i] / spacing
            if coarser < 1.0:
                ray = x / distance, y / distance, z / distance
                thick[i] = opacities[i] * _compensation(ray, scales, quats, i, spacing, coarser, blur)
        task = take_number(counter)


@kernel
def _compensation(ray, scales, quats, i, spacing, coarser, blur):
    """Filter as `recon.scene.sampling._compensation`."""
    w, a, b, c = float(quats[i, 0]), float(quats[i, 1]), float(quats[i, 2]), float(quats[i, 3])
    length = math.sqrt(w * w + a * a + b * b + c * c)
    if not length > 0.0:
        return 1.0  # one without direction is never drawn
    w, a, b, c = w / length, a / length, b / length, c / length
    x, y, z = ray
    twice_x, twice_y, twice_z = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    along_x = (x - w * twice_x + b * twice_z - c * twice_y) ** 2
    along_y = (y - w * twice_y + c * twice_x - a * twice_z) ** 2
    along_z = (z - w * twice_z + a * twice_y - b * twice_x) ** 2
    first, second, third = (
        (scales[i, 0] / spacing) ** 2,
        (scales[i, 1] / spacing) ** 2,
        (scales[i, 2] / spacing) ** 2,
    )
    theirs = blur * coarser * coarser
    sharp = second * third * along_x + third * first * along_y + first * second * along_z
    wide = first * max(1 - along_x, 0.0) + second * max(1 - along_y, 0.0) + third * max(1 - along_z, 0.0)
    return math.sqrt((sharp + theirs * (wide + theirs)) / (sharp + blur * (wide + blur)))
