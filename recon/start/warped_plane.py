# mypy: allow-untyped-defs, allow-untyped-calls
"""Warping of a view to another one, as if all it shows lay on a plane, and how alike the two then are."""

import numpy as np

from imaging.arrays import Array, Array32, Mask
from imaging.compute.jit import inlined, kernel
from recon.splat import SplatCamera

PATCH = 7
"""Pixels of the coarse image."""
_HALF, _SHARE = PATCH // 2, 1.0 / (PATCH * PATCH)
SOFT = 1e-4
"""Variance of log light that is as good as none, as of noise."""


def warp(lens: SplatCamera, picture: Array32, rays: Array, shift: Array, out: Array32, shown: Mask) -> None:
    """Fill `out` with what a picture of a camera shows at points `rays + shift`, `shown` with where it does.

    Args:
        lens: Camera of the picture.
        picture: Float32 [H, W], the whole image of `lens` at any size.
        rays: Float64 [h, w, 3], in the axes of that camera.
        shift: Float64 [3], in the same axes.
        out: Values [h, w] to fill; outside the picture what the nearest border shows, or 0 behind the camera.
        shown: Mask [h, w] to fill, True where the picture shows the point.
    """
    _warp(picture, rays, shift, *_constants(lens), out, shown)


def compare_planes(
    lens: SplatCamera,
    picture: Array32,
    rays: Array,
    shift: Array,
    planes: Array,
    image: Array32,
    first: Array32,
    second: Array32,
) -> None:
    """Raise the best scores of an image, on each of D planes, to those of a picture.

    A score is the correlation of patches of the image and of what the camera shows at points
    `rays + planes[i] * shift` (see `warp`); it is -1 where that is beyond the camera's picture.

    Args:
        lens: Camera of the picture.
        picture: Log light, float32 [H, W], the whole image of `lens` at any size.
        rays: Float64 [h, w, 3], through the pixels of the image, in the axes of that camera.
        shift: Float64 [3], from that camera to the one of the image, in the same axes.
        planes: Inverse depths [D] of the planes.
        image: Log light, float32 [h, w].
        first: Best scores so far, [D, h, w], changed in place; -1 at the start.
        second: Second best scores, likewise, or `first` again where one is enough.
    """
    two = first is not second
    _compare(picture, rays, shift, planes, *_constants(lens), image, first, second, two)


def _constants(lens: SplatCamera) -> tuple[Array, bool, float, Array]:
    size = np.array([lens.width, lens.height], np.float64)
    return np.array(lens.lens), lens.fisheye, lens.monotone_radius2, size


@inlined
def _reflected(index, count):
    """Index within a row of that many that continues as its mirror image at both ends, without the ends."""
    while index < 0 or index >= count:
        index = -index if index < 0 else 2 * count - 2 - index
        if count == 1:
            index = 0
    return index


@inlined
def _across(column, out):
    """Sums [w] of each PATCH neighbours in a row [w + PATCH - 1], whose ends are set here."""
    width = len(out)
    for x in range(_HALF):
        column[_HALF - 1 - x] = column[_HALF + _reflected(-1 - x, width)]
        column[_HALF + width + x] = column[_HALF + _reflected(width + x, width)]
    for x in range(width):
        total = 0.0
        for step in range(PATCH):
            total += column[x + step]
        out[x] = total


@inlined
def _add_row(sign, values, others, columns):
    alone, square, both = columns[0, _HALF:], columns[1, _HALF:], columns[2, _HALF:]
    for x in range(len(values)):
        v = values[x]
        signed = sign * v
        alone[x] += signed
        square[x] += signed * v
        both[x] += signed * others[x]


@inlined
def _patches(values, others, row, columns, sums):
    """Move sums on to the patches of a row: of values, of their squares, and of products with others.

    columns [3, w + PATCH - 1]: sums down the columns before this row. Rows come in turn from 1 - PATCH; sums
    [3, w] are those of patches from row 0 on.
    """
    height = len(values)
    come, gone = _reflected(row + _HALF, height), _reflected(row - _HALF - 1, height)
    _add_row(1.0, values[come], others[come], columns)
    if row > 0:
        _add_row(-1.0, values[gone], others[gone], columns)
    if row >= 0:
        for one in range(3):
            _across(columns[one], sums[one])


@kernel
def _compare(picture, rays, shift, planes, lens, fisheye, fold, size, image, first, second, two):
    # In float64: on a bare wall nothing must be left of the difference of two large numbers.
    height, width = image.shape
    warped, shown = np.empty((height, width)), np.empty((height, width), np.bool_)
    image = image.astype(np.float64)
    columns, sums = np.zeros((3, width + PATCH - 1)), np.empty((3, width))
    mean, deviation = np.empty((height, width)), np.empty((height, width))
    alone, square, both, scores = sums[0], sums[1], sums[2], np.empty(width, np.float32)
    for row in range(1 - PATCH, height):
        _patches(image, image, row, columns, sums)
        if row >= 0:
            near, spread = mean[row], deviation[row]
            for x in range(width):
                near[x] = alone[x] * _SHARE
                spread[x] = np.sqrt(max(square[x] * _SHARE - near[x] * near[x], 0.0) + SOFT)
    for plane in range(len(planes)):
        _warp(picture, rays, planes[plane] * shift, lens, fisheye, fold, size, warped, shown)
        columns[:] = 0.0
        for row in range(1 - PATCH, height):
            _patches(warped, image, row, columns, sums)
            if row < 0:
                continue
            near, spread, there = mean[row], deviation[row], shown[row]
            best, next_best = first[plane, row], second[plane, row]
            for x in range(width):
                other = alone[x] * _SHARE
                # Softened one by one: texture before a flat patch is as unlike as before other texture.
                root = np.sqrt(max(square[x] * _SHARE - other * other, 0.0) + SOFT)
                score = (both[x] * _SHARE - near[x] * other + SOFT) / (spread[x] * root)
                score = np.float32(score if there[x] else -1.0)
                scores[x] = score
            if two:
                for x in range(width):
                    next_best[x] = max(next_best[x], min(best[x], scores[x]))
            for x in range(width):
                best[x] = max(best[x], scores[x])


@inlined
def _fisheye(x, y, terms):
    """Bend tangents [w] as an equidistant fisheye does."""
    for column in range(len(x)):
        radius = np.sqrt(x[column] * x[column] + y[column] * y[column])
        if radius > 0.0:
            angle = np.arctan(radius)
            q = angle * angle
            ratio = angle * (1.0 + q * (terms[4] + q * (terms[5] + q * (terms[6] + q * terms[7])))) / radius
            x[column] *= ratio
            y[column] *= ratio


@inlined
def _brown(x, y, terms):
    """Bend tangents [w] as Brown's lens does."""
    k1, k2, p1, p2 = terms[4], terms[5], terms[6], terms[7]
    for column in range(len(x)):
        u, v = x[column], y[column]
        square = u * u + v * v
        radial = 1.0 + square * (k1 + square * k2)
        x[column] = u * radial + 2.0 * p1 * u * v + p2 * (square + 2.0 * u * u)
        y[column] = v * radial + p1 * (square + 2.0 * v * v) + 2.0 * p2 * u * v


@kernel
def _warp(picture, rays, shift, terms, fisheye, fold, size, out, shown):
    # Loops over a row, of which the compiler makes vectors; only looking up goes pixel by pixel.
    rows, columns = picture.shape
    width, shift_x, shift_y, shift_z = rays.shape[1], shift[0], shift[1], shift[2]
    fx, fy, cx, cy = terms[0], terms[1], terms[2], terms[3]
    x, y, ahead = np.empty(width), np.empty(width), np.empty(width, np.bool_)
    for row in range(rays.shape[0]):
        towards, values, visible = rays[row], out[row], shown[row]
        for column in range(width):
            z = towards[column, 2] + shift_z
            ahead[column] = z > 0.0
            inverse = 1.0 / (z if z > 0.0 else 1.0)
            x[column] = (towards[column, 0] + shift_x) * inverse
            y[column] = (towards[column, 1] + shift_y) * inverse
        if np.isfinite(fold):  # beyond it the lens would fold the world back into the image
            for column in range(width):
                square = x[column] * x[column] + y[column] * y[column]
                shrink = np.sqrt(fold / square) if square > fold else 1.0
                x[column] *= shrink
                y[column] *= shrink
        if fisheye:
            _fisheye(x, y, terms)
        else:
            _brown(x, y, terms)
        for column in range(width):
            u, v = x[column] * fx + cx, y[column] * fy + cy
            visible[column] = ahead[column] & (u >= 0.0) & (u < size[0]) & (v >= 0.0) & (v < size[1])
            x[column] = min(max(u * columns / size[0] - 0.5, 0.0), columns - 1.0)
            y[column] = min(max(v * rows / size[1] - 0.5, 0.0), rows - 1.0)
        for column in range(width):
            if not ahead[column]:
                values[column] = 0.0
                continue
            left, top = min(int(x[column]), columns - 2), min(int(y[column]), rows - 2)
            right, low = x[column] - left, y[column] - top
            above = picture[top, left] * (1.0 - right) + picture[top, left + 1] * right
            below = picture[top + 1, left] * (1.0 - right) + picture[top + 1, left + 1] * right
            values[column] = above * (1.0 - low) + below * low
