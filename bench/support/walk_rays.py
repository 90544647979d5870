"""The rays of `bench.support.walk`: boxes with textures, one ray a pixel."""

import math
from typing import Any

import numpy as np

from imaging.compute.jit import compiled

LEVELS = 4
"""Mipmap levels of each texture, halved each time."""
TILE = 50
"""px; the boxes that each tile may show are found before any ray is sent."""


@compiled
def cast(
    directions: Any, pose: Any, focal: float, boxes: Any, light: Any, texels: Any, at: Any,
    numbers: Any, starts: Any, linear: Any, codes: Any,
    exposure: float, slope: float, floor: float, seed: Any, pixels: Any,
) -> None:  # fmt: skip
    """Send a ray through every pixel of `pixels`, uint8 [H, W, 3]; the scene is as `House` has it.

    directions: [H, W, 2], x and y of the rays whose z is 1. numbers, starts: the boxes of each tile. linear,
    codes: tables from sRGB codes to light and, in 8192 steps, back. slope, floor: of the variance.
    """
    height, width = pixels.shape[:2]
    columns = (width + TILE - 1) // TILE
    turn = np.ascontiguousarray(pose[:3, :3].T)
    centre = -turn @ np.ascontiguousarray(pose[:3, 3])
    state = np.uint64(seed * np.uint64(0x9E3779B97F4A7C15))
    for row in range(height):
        for column in range(width):
            tile = (row // TILE) * columns + column // TILE
            u, v = directions[row, column, 0], directions[row, column, 1]
            dx = turn[0, 0] * u + turn[0, 1] * v + turn[0, 2]
            dy = turn[1, 0] * u + turn[1, 1] * v + turn[1, 2]
            dz = turn[2, 0] * u + turn[2, 1] * v + turn[2, 2]
            nearest, hit, face = 1e9, -1, 0
            for place in range(starts[tile], starts[tile + 1]):
                box = numbers[place]
                c, s = math.cos(boxes[box, 6]), math.sin(boxes[box, 6])
                ox, oy, oz = centre[0] - boxes[box, 0], centre[1] - boxes[box, 1], centre[2] - boxes[box, 2]
                px, py, pz = c * ox + s * oy, c * oy - s * ox, oz
                qx, qy, qz = c * dx + s * dy, c * dy - s * dx, dz
                enter, leave, side = 0.0, 1e9, -1
                for axis in range(3):
                    p = px if axis == 0 else (py if axis == 1 else pz)
                    q = qx if axis == 0 else (qy if axis == 1 else qz)
                    half = boxes[box, 3 + axis]
                    if abs(q) < 1e-12:
                        if abs(p) > half:
                            leave = -1.0
                        continue
                    one, two = (-half - p) / q, (half - p) / q
                    if one > two:
                        one, two = two, one
                    if one > enter:
                        enter, side = one, 2 * axis + (1 if q < 0 else 0)
                    leave = min(leave, two)
                if side >= 0 and enter < leave and enter < nearest:
                    nearest, hit, face = enter, box, side
            red, green, blue = 0.45, 0.6, 0.85  # the sky
            if hit >= 0:
                c, s = math.cos(boxes[hit, 6]), math.sin(boxes[hit, 6])
                ox, oy = centre[0] + nearest * dx - boxes[hit, 0], centre[1] + nearest * dy - boxes[hit, 1]
                x, y, z = c * ox + s * oy, c * oy - s * ox, centre[2] + nearest * dz - boxes[hit, 2]
                axis = face // 2
                normal = c * dx + s * dy if axis == 0 else (c * dy - s * dx if axis == 1 else dz)
                slant = max(abs(normal) / math.sqrt(dx * dx + dy * dy + dz * dz), 0.05)
                density = boxes[hit, 7]
                step = nearest * density / focal / math.sqrt(slant)
                level = min(max(int(math.log2(max(step, 1.0)) + 0.5), 0), LEVELS - 1)
                first, high, wide = at[hit, face, level, 0], at[hit, face, level, 1], at[hit, face, level, 2]
                a = y + boxes[hit, 4] if axis == 0 else x + boxes[hit, 3]
                b = y + boxes[hit, 4] if axis == 2 else z + boxes[hit, 5]
                across, up = (4, 5) if axis == 0 else ((3, 5) if axis == 1 else (3, 4))
                i = min(max(a / (2 * boxes[hit, across]) * wide - 0.5, 0.0), wide - 1.001)
                j = min(max(b / (2 * boxes[hit, up]) * high - 0.5, 0.0), high - 1.001)
                i0, j0 = int(i), int(j)
                fi, fj = i - i0, j - j0
                base = first + j0 * wide + i0
                right = 1 if wide > 1 else 0
                under = wide if high > 1 else 0
                lit = light[hit, face]
                for band in range(3):
                    upper = (1 - fi) * linear[texels[base, band]] + fi * linear[texels[base + right, band]]
                    beneath = base + under
                    lower = (1 - fi) * linear[texels[beneath, band]]
                    lower += fi * linear[texels[beneath + right, band]]
                    value = (1 - fj) * upper + fj * lower
                    if band == 0:
                        red = lit * value
                    elif band == 1:
                        green = lit * value
                    else:
                        blue = lit * value
            for band in range(3):
                signal = exposure * (red if band == 0 else (green if band == 1 else blue))
                total = 0
                state ^= state << np.uint64(13)
                state ^= state >> np.uint64(7)
                state ^= state << np.uint64(17)
                for part in range(4):  # four bytes add up to nearly a normal number
                    total += int((state >> np.uint64(16 * part)) & np.uint64(255))
                signal += (total - 510) / 147.8 * math.sqrt(slope * signal + floor)
                pixels[row, column, band] = codes[int(min(max(signal, 0.0), 1.0) * 8191 + 0.5)]
