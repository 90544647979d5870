# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Projection of Gaussians in the world to ellipses in the image: one thread a Gaussian, in float64.

Positions in pixels and the covariances of needles need more digits than float32 has; opacities, reaches and
sizes do not, and are float32.
"""

import math

import triton
import triton.language as tl

from recon.splat import limits, parameters, tables
from recon.splat.gpu.formulas import covariance, distort, root_covariance, rotation, screen_axes, to_camera
from recon.splat.gpu.inputs import BOUNDS, LENS, LIMITS, read_gaussian, read_parameters

BLOCK = 128
"""Gaussians of a program."""
OPTIONS = {"enable_fp_fusion": True}
"""Options of every kernel: products and sums may be contracted, as on the CPU (Triton's default changes)."""
WIDE, HIGH = tl.constexpr(16), tl.constexpr(8)
"""Pixels of a tile across and down: four for each thread of a warp. Of the 16x16 tiles of other rasterisers,
a small Gaussian touches but one half as often as both."""
RECORD = tl.constexpr(16)
"""Float32 numbers of a record, a cache line: pixel mean x, y in two parts each; m11; m21, m22 in two parts
each; one that is free; from PAINT on -reach, opacity, red, green, blue (see `recon.splat.tables.Projected`).
The second part of a number is what float32 leaves of it: together they have 48 bits."""
PAINT = tl.constexpr(10)
_FOLD = tl.constexpr(parameters.FOLD)
_ALPHA_FLOOR = tl.constexpr(limits.ALPHA_FLOOR)
_COLOUR_MOST = tl.constexpr(limits.COLOUR_MOST)
_QUAT_LEAST = tl.constexpr(limits.QUAT_LEAST)
_SKIPPED, DRAWN, _BAD = (tl.constexpr(int(x)) for x in (tables.SKIPPED, tables.DRAWN, tables.BAD))
_INFINITY = tl.constexpr(math.inf)
_LARGEST = tl.constexpr(3e38)
_SLACK = tl.constexpr(1e-6)
"""The box is wider by this fraction, some roundings of float32."""


@triton.jit
def _finite(value):
    return tl.abs(value) < _INFINITY


@triton.jit
def _sound(mean, quat, scale, opacity, red, green, blue):
    """All numbers finite, scales positive, opacity not negative, quaternion with a direction, colours in
    range."""
    x, y, z = mean
    qw, qx, qy, qz = quat
    sx, sy, sz = scale
    turned = tl.maximum(tl.maximum(tl.abs(qw), tl.abs(qx)), tl.maximum(tl.abs(qy), tl.abs(qz)))
    placed = _finite(x) & _finite(y) & _finite(z)
    directed = _finite(qw) & _finite(qx) & _finite(qy) & _finite(qz) & (turned >= _QUAT_LEAST)
    sized = _finite(sx) & _finite(sy) & _finite(sz) & (sx > 0.0) & (sy > 0.0) & (sz > 0.0)
    painted = (tl.abs(red) <= _COLOUR_MOST) & (tl.abs(green) <= _COLOUR_MOST) & (tl.abs(blue) <= _COLOUR_MOST)
    return placed & directed & sized & painted & _finite(opacity) & (opacity >= 0.0)


@triton.jit
def _opacity_and_reach(opacity, red, green, blue, k):
    """Test for being above its floor, the clamped opacity, and log2 of the ratio to the floor; float32."""
    most, least, dimmest = k[LIMITS + 2].to(tl.float32), k[LIMITS + 3].to(tl.float32), k[LIMITS + 4]
    brightest = tl.maximum(tl.maximum(red, green), blue)
    lit = (brightest > 0.0) & _finite(brightest)
    ceiling = tl.where(lit, dimmest.to(tl.float32) / tl.where(lit, brightest, 1.0), least)
    lowest = tl.maximum(tl.minimum(ceiling, least), _ALPHA_FLOOR)
    o = tl.minimum(opacity, most)
    visible = o >= lowest
    return visible, o, tl.maximum(tl.log2(tl.where(visible, o / lowest, 1.0)), 0.0)


@triton.jit
def _store_parts(pointer, value, mask):
    """A float64 number as two of float32."""
    first = value.to(tl.float32)
    tl.store(pointer, first, mask=mask)
    tl.store(pointer + 1, (value - first.to(tl.float64)).to(tl.float32), mask=mask)


@triton.jit
def project(
    means, quats, scales, opacities, colours, parameter, n, record, box, depth, radius, state,
    BLOCK: tl.constexpr, FISHEYE: tl.constexpr,
):  # fmt: skip
    """Project N Gaussians; float32 inputs as in `rasterize`.

    record float32 [N, RECORD]. box int32 [N, 4], depth, radius float32 [N], state int8 [N]: as in
    `recon.splat.tables.Projected`; depth is infinite where not drawn.
    """
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    here = i < n
    i = i.to(tl.int64)
    k = read_parameters(parameter)
    mean, quat, scale = read_gaussian(means, quats, scales, i, here)
    opacity = tl.load(opacities + i, mask=here, other=0.0)
    red = tl.load(colours + 3 * i, mask=here, other=0.0)
    green = tl.load(colours + 3 * i + 1, mask=here, other=0.0)
    blue = tl.load(colours + 3 * i + 2, mask=here, other=0.0)

    # What is not drawn anyway is replaced by harmless numbers, so that nothing below overflows.
    sound = _sound(mean, quat, scale, opacity, red, green, blue)
    mean = (tl.where(sound, mean[0], 0.0), tl.where(sound, mean[1], 0.0), tl.where(sound, mean[2], 0.0))
    quat = (
        tl.where(sound, quat[0], 1.0),
        tl.where(sound, quat[1], 0.0),
        tl.where(sound, quat[2], 0.0),
        tl.where(sound, quat[3], 0.0),
    )
    scale = (tl.where(sound, scale[0], 1.0), tl.where(sound, scale[1], 1.0), tl.where(sound, scale[2], 1.0))
    x, y, z = to_camera(mean, k)
    ahead = sound & (z >= k[LIMITS])
    x, y, z = tl.where(ahead, x, 0.0), tl.where(ahead, y, 0.0), tl.where(ahead, z, 1.0)

    axes, tangents, _ = screen_axes((x, y, z), k, FISHEYE)
    u, v = tangents[0], tangents[1]
    ahead = ahead & (u * u + v * v < k[BOUNDS + 4])
    m = root_covariance(axes, rotation(quat), scale)
    a, b, c, determinant = covariance(m, k[LIMITS + 1])
    sane = (tl.maximum(a, c) <= k[LIMITS + 5]) & (determinant < _INFINITY)
    visible, o, reach = _opacity_and_reach(opacity, red, green, blue, k)

    # q = (m11 dx)^2 + (m21 dx + m22 dy)^2 with the factor FOLD^2; the ellipse is q <= reach.
    deviation = tl.sqrt(a)
    dx, dy, _, _, _ = distort(u, v, k, FISHEYE)
    px, py = k[LENS] * dx + k[LENS + 2], k[LENS + 1] * dy + k[LENS + 3]
    # Sizes need no float64, which costs much in roots; the box is wider by more than they are rounded.
    wide, slant = tl.where(sane, a, 1.0).to(tl.float32), tl.where(sane, b, 0.0).to(tl.float32)
    tall = tl.where(sane, c, 1.0).to(tl.float32)
    across = tl.sqrt(reach) * ((1.0 + _SLACK) / _FOLD)
    rx, ry = (across * tl.sqrt(wide)).to(tl.float64), (across * tl.sqrt(tall)).to(tl.float64)
    half = 0.5 * (wide - tall)
    longest = 3.0 * tl.sqrt(0.5 * (wide + tall) + tl.sqrt(half * half + slant * slant))
    width, height = k[LIMITS + 6], k[LIMITS + 7]
    first_x = tl.ceil(tl.maximum(px - rx - 0.5, 0.0))
    last_x = tl.floor(tl.minimum(px + rx - 0.5, width - 1.0))
    first_y = tl.ceil(tl.maximum(py - ry - 0.5, 0.0))
    last_y = tl.floor(tl.minimum(py + ry - 0.5, height - 1.0))
    drawn = ahead & sane & visible & (last_x >= first_x) & (last_y >= first_y)
    bad = (~sound) | (ahead & (~sane))

    tl.store(state + i, tl.where(bad, _BAD, tl.where(drawn, DRAWN, _SKIPPED)).to(tl.int8), mask=here)
    tl.store(depth + i, tl.where(drawn, tl.minimum(z, _LARGEST), _INFINITY).to(tl.float32), mask=here)
    tl.store(radius + i, tl.where(drawn, longest, 0.0), mask=here)
    keep = here & drawn
    at = record + i * RECORD
    m22 = tl.sqrt(a / determinant) * _FOLD
    _store_parts(at, px, keep)
    _store_parts(at + 2, py, keep)
    tl.store(at + 4, (1.0 / deviation * _FOLD).to(tl.float32), mask=keep)
    _store_parts(at + 5, -(m22 * b / a), keep)
    _store_parts(at + 7, m22, keep)
    at += PAINT
    tl.store(at, -reach, mask=keep)
    tl.store(at + 1, o, mask=keep)
    tl.store(at + 2, red, mask=keep)
    tl.store(at + 3, green, mask=keep)
    tl.store(at + 4, blue, mask=keep)
    at = box + 4 * i
    tl.store(at, first_x.to(tl.int32), mask=keep)
    tl.store(at + 1, last_x.to(tl.int32), mask=keep)
    tl.store(at + 2, first_y.to(tl.int32), mask=keep)
    tl.store(at + 3, last_y.to(tl.int32), mask=keep)
