"""Warping of a view to another one, as if all it shows lay on a plane, pixel by pixel."""

import numpy as np

from imaging.arrays import Array, Array32, Mask
from imaging.compute.jit import kernel
from recon.splat import SplatCamera


def warp(lens: SplatCamera, picture: Array32, rays: Array, shift: Array, out: Array32, shown: Mask) -> None:
    """Fill `out` [h, w] with what a picture of a camera shows at points `rays + shift`, `shown` with where.

    Elsewhere `out` is what the nearest border shows, or 0 behind the camera.

    picture: float32 [H, W], the whole image of `lens` at any size. rays: float64 [h, w, 3], in the axes of
    that camera; shift: float64 [3].
    """
    _warp(
        picture,
        rays,
        shift,
        np.array(lens.lens),
        lens.fisheye,
        lens.monotone_radius2,
        np.array([lens.width, lens.height], np.float64),
        out,
        shown,
    )


@kernel
def _warp(
    picture: Array32,
    rays: Array,
    shift: Array,
    lens: Array,
    fisheye: bool,
    fold: float,
    size: Array,
    out: Array32,
    shown: Mask,
) -> None:
    fx, fy, cx, cy, k1, k2, k3, k4 = lens
    rows, columns = picture.shape
    for row in range(rays.shape[0]):
        for column in range(rays.shape[1]):
            out[row, column], shown[row, column] = 0.0, False
            z = rays[row, column, 2] + shift[2]
            if z <= 0.0:
                continue
            u = (rays[row, column, 0] + shift[0]) / z
            v = (rays[row, column, 1] + shift[1]) / z
            square = u * u + v * v
            if square > fold:  # beyond it the lens would fold the world back into the image
                u *= np.sqrt(fold / square)
                v *= np.sqrt(fold / square)
                square = fold
            if fisheye:
                radius = np.sqrt(square)
                if radius > 0.0:
                    angle = np.arctan(radius)
                    q = angle * angle
                    ratio = angle * (1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4)))) / radius
                    u *= ratio
                    v *= ratio
            else:  # k3 and k4 are Brown's p1 and p2
                radial = 1.0 + square * (k1 + square * k2)
                u, v = (
                    u * radial + 2.0 * k3 * u * v + k4 * (square + 2.0 * u * u),
                    v * radial + k3 * (square + 2.0 * v * v) + 2.0 * k4 * u * v,
                )
            x, y = u * fx + cx, v * fy + cy
            shown[row, column] = 0.0 <= x < size[0] and 0.0 <= y < size[1]
            x = min(max(x * columns / size[0] - 0.5, 0.0), columns - 1.0)
            y = min(max(y * rows / size[1] - 0.5, 0.0), rows - 1.0)
            left, top = min(int(x), columns - 2), min(int(y), rows - 2)
            x -= left
            y -= top
            above = picture[top, left] * (1.0 - x) + picture[top, left + 1] * x
            below = picture[top + 1, left] * (1.0 - x) + picture[top + 1, left + 1] * x
            out[row, column] = above * (1.0 - y) + below * y
