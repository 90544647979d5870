# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Projection of a Gaussian in the world to an ellipse in the image: the forward half of EWA splatting.

Computed in float64, eight Gaussians at a time: positions in pixels and the covariances of needles need
more digits than float32 has. The functions here work on lanes; `k` is the vector of `parameters`.
`fisheye` is None for a Brown lens: then the compiler leaves the other lens out, and else this one.
"""

import math

import numpy as np

from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import take_number
from recon.splat.cpu.formulas import covariance, distort, root_covariance, rotation, screen_axes, to_camera
from recon.splat.cpu.lanes import (
    WIDTH_64,
    above,
    at_least,
    both,
    ceiling,
    choose,
    floor,
    load,
    maximum,
    minimum,
    minus,
    root,
    splat,
    split_exponent,
    store,
)
from recon.splat.cpu.tiles import TASK
from recon.splat.limits import ALPHA_FLOOR, COLOUR_MOST, QUAT_LEAST
from recon.splat.parameters import BOUNDS, FOLD, LENS, LIMITS
from recon.splat.tables import DRAWN, PAINT

INPUTS = 11
"""Numbers of a Gaussian before its colours: mean 3, quaternion 4, scale 3, opacity."""
_OUTPUTS = 14
_LOG = 2.0 / math.log(2.0)


@inlined
def read_eight(means, quats, scales, opacities, ids, values):
    """Gaussians ids int64 [8] as float64 [INPUTS * 8], number by number, so that lanes can load them."""
    for j in range(WIDTH_64):
        i = ids[j]
        for a in range(3):
            values[a * 8 + j] = means[i, a]
            values[(7 + a) * 8 + j] = scales[i, a]
        for a in range(4):
            values[(3 + a) * 8 + j] = quats[i, a]
        values[80 + j] = opacities[i]


@inlined
def _read_colours(colours, ids, values):
    """Their colours behind the other numbers."""
    for j in range(WIDTH_64):
        for a in range(colours.shape[1]):
            values[(INPUTS + a) * 8 + j] = colours[ids[j], a]


@inlined
def _log2(x):
    """log2 to 1e-12, by the series of artanh, for positive normal numbers."""
    m, e = split_exponent(x)
    z = (m - 1.0) / (m + 1.0)
    s = z * z
    series = 1.0 / 9 + s * (1.0 / 11 + s * (1.0 / 13))
    return e + _LOG * z * (1.0 + s * (1.0 / 3 + s * (1.0 / 5 + s * (1.0 / 7 + s * series))))


@inlined
def _sound(values):
    """Mask: all numbers finite, scales positive, opacity not negative, quaternion with a direction, colours
    in range."""
    nothing = splat(0.0)
    for a in range(0, len(values), 8):
        nothing = nothing + load(values, a) * 0.0
    smallest = minimum(minimum(load(values, 56), load(values, 64)), load(values, 72))
    turned = splat(0.0)
    for a in range(3, 7):
        q = load(values, a * 8)
        turned = maximum(turned, maximum(q, minus(q)))
    brightest = splat(0.0)
    for a in range(INPUTS * 8, len(values), 8):
        c = load(values, a)
        brightest = maximum(brightest, maximum(c, minus(c)))
    shaped = both(above(smallest, 0.0), at_least(turned, QUAT_LEAST))
    shaped = both(shaped, at_least(COLOUR_MOST, brightest))
    # Zero times a number that is not finite is NaN, which is not at least zero.
    return both(both(at_least(nothing, 0.0), at_least(load(values, 80), 0.0)), shaped)


@inlined
def _opacity_and_reach(values, k):
    """Clamped opacity, and log2 of how far above its floor it is."""
    brightest = load(values, INPUTS * 8)
    for a in range((INPUTS + 1) * 8, len(values), 8):
        brightest = maximum(brightest, load(values, a))
    ceiling_ = choose(above(brightest, 0.0), k[LIMITS + 4] / brightest, k[LIMITS + 3])
    lowest = maximum(minimum(ceiling_, k[LIMITS + 3]), ALPHA_FLOOR)
    o = minimum(load(values, 80), k[LIMITS + 2])
    visible = at_least(o, lowest)
    return visible, o, maximum(_log2(choose(visible, o / lowest, splat(1.0))), 0.0)


@inlined
def _project_eight(values, k, fisheye, out):
    """Fill out float64 [_OUTPUTS * 8] with, eight at a time: state, camera z, three-sigma radius, the five
    numbers of Projected.shape, the reach, the opacity, the four of Projected.box.
    """
    sound = _sound(values)
    point = to_camera((load(values, 0), load(values, 8), load(values, 16)), k)
    z = point[2]
    axes, tangents, _ = screen_axes(point, k, fisheye)
    u, v = tangents[0], tangents[1]
    ahead = both(at_least(z, k[LIMITS]), above(k[BOUNDS + 4], u * u + v * v))
    r = rotation((load(values, 24), load(values, 32), load(values, 40), load(values, 48)))
    m = root_covariance(axes, r, (load(values, 56), load(values, 64), load(values, 72)))
    a, b, c, determinant = covariance(m, k[LIMITS + 1])
    sane = both(at_least(k[LIMITS + 5], maximum(a, c)), above(math.inf, determinant))
    visible, o, reach = _opacity_and_reach(values, k)

    # q = (m11 dx)^2 + (m21 dx + m22 dy)^2 with the factor FOLD^2; the ellipse is q <= reach.
    deviation, across = root(a), root(reach)
    m11 = FOLD / deviation
    m22 = FOLD * root(a / determinant)
    m21 = minus(m22 * b / a)
    dx, dy, _, _, _ = distort(u, v, k, fisheye)
    px, py = k[LENS] * dx + k[LENS + 2], k[LENS + 1] * dy + k[LENS + 3]
    rx, ry = across * deviation * (1.0 / FOLD), across * root(c) * (1.0 / FOLD)
    first_x = ceiling(maximum(px - rx - 0.5, 0.0))
    last_x = floor(minimum(px + rx - 0.5, k[LIMITS + 6] - 1.0))
    first_y = ceiling(maximum(py - ry - 0.5, 0.0))
    last_y = floor(minimum(py + ry - 0.5, k[LIMITS + 7] - 1.0))
    visible = both(visible, both(at_least(last_x, first_x), at_least(last_y, first_y)))
    half = 0.5 * (a - c)
    radius = 3.0 * root(0.5 * (a + c) + root(half * half + b * b))

    state = choose(sane, choose(visible, splat(1.0), 0.0), splat(2.0))
    state = choose(sound, choose(ahead, state, 0.0), splat(2.0))
    store(out, 0, state)
    store(out, 8, z)
    store(out, 16, radius)
    store(out, 24, px)
    store(out, 32, py)
    store(out, 40, m11)
    store(out, 48, m21)
    store(out, 56, m22)
    store(out, 64, reach)
    store(out, 72, o)
    store(out, 80, first_x)
    store(out, 88, last_x)
    store(out, 96, first_y)
    store(out, 104, last_y)


@kernel
def project(counter, means, quats, scales, opacities, colours, k, fisheye, out):
    """Project N Gaussians; float32 inputs as in `rasterize`, out: Projected; fisheye: None or True."""
    n = len(means)
    ids = np.empty(8, np.int64)
    values, results = np.empty((INPUTS + colours.shape[1]) * 8), np.empty(_OUTPUTS * 8)
    task = take_number(counter)
    while task * TASK < n:
        stop = min((task + 1) * TASK, n)
        for first in range(task * TASK, stop, 8):
            for j in range(8):
                ids[j] = min(first + j, stop - 1)
            read_eight(means, quats, scales, opacities, ids, values)
            _read_colours(colours, ids, values)
            _project_eight(values, k, fisheye, results)
            for j in range(min(8, stop - first)):
                i = first + j
                state = np.uint8(results[j])
                out.state[i] = state
                if state == DRAWN:
                    out.depth[i] = results[8 + j]
                    out.radius[i] = results[16 + j]
                    for a in range(5):
                        out.shape[i, a] = results[24 + 8 * a + j]
                    out.paint[i, PAINT], out.paint[i, PAINT + 1] = -results[64 + j], results[72 + j]
                    for a in range(colours.shape[1]):
                        out.paint[i, PAINT + 2 + a] = colours[i, a]
                    for a in range(4):
                        out.box[i, a] = int(results[80 + 8 * a + j])
        task = take_number(counter)
