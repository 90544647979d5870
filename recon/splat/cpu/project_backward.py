# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project`: from sums over pixels to means, rotations, scales and opacities.

As there, in float64 and eight Gaussians at a time.
"""

import numpy as np

from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import take_number
from recon.splat.cpu.composite_backward import SLOT
from recon.splat.cpu.fisheye import radial as fisheye_radial
from recon.splat.cpu.lanes import above, at_least, both, choose, load, minimum, minus, root, store
from recon.splat.cpu.project import (
    INPUTS,
    covariance,
    distort,
    read_eight,
    root_covariance,
    rotation,
    screen_axes,
    to_camera,
)
from recon.splat.cpu.project_view import add_view, clear_view, finish_view
from recon.splat.cpu.tiles import TASK, TILE
from recon.splat.moved import VIEW
from recon.splat.parameters import BOUNDS, LENS, LIMITS

MOMENTS = 6
"""Sums over pixels of s, s dx, s dy, s dx dx, s dx dy, s dy dy: s = alpha d loss / d alpha, (dx, dy) from
the mean to the pixel."""
_OUTPUTS = 13
"""Gradients of mean 3, quaternion 4, scale 3, opacity, and of the pixel mean 2."""


@inlined
def _add_slots(slots, first, last, tile, entry, across, px, py, moments, j, colour):
    """Add up a Gaussian's slots in their order: lane j of moments, colour [3]; returns the largest weight."""
    s = sx = sy = sxx = sxy = syy = red = green = blue = peak = 0.0
    for slot in range(first, last):
        t = tile[entry + slot - first]
        ox = (t % across) * TILE + 0.5 * TILE - px
        oy = (t // across) * TILE + 0.5 * TILE - py
        at = SLOT * slot
        m, mx, my = np.float64(slots[at]), np.float64(slots[at + 1]), np.float64(slots[at + 2])
        s += m
        sx += mx + ox * m
        sy += my + oy * m
        sxx += slots[at + 3] + 2.0 * ox * mx + ox * ox * m
        sxy += slots[at + 4] + ox * my + oy * mx + ox * oy * m
        syy += slots[at + 5] + 2.0 * oy * my + oy * oy * m
        red += slots[at + 6]
        green += slots[at + 7]
        blue += slots[at + 8]
        peak = max(peak, np.float64(slots[at + 9]))
    moments[j], moments[8 + j], moments[16 + j] = s, sx, sy
    moments[24 + j], moments[32 + j], moments[40 + j] = sxx, sxy, syy
    colour[0], colour[1], colour[2] = red, green, blue
    return peak


@inlined
def _lens_curvature(u, v, k, fisheye):
    """Second derivatives of the distorted tangents: xuu, xuv, xvv = yuv, yvv (yuu = xuv)."""
    if fisheye is not None:
        _, slope, curve = fisheye_radial(u * u + v * v, k)
        return (
            u * (3.0 * slope + curve * u * u),
            v * (slope + curve * u * u),
            u * (slope + curve * v * v),
            v * (3.0 * slope + curve * v * v),
        )
    k1, k2, p1, p2 = k[LENS + 4], k[LENS + 5], k[LENS + 6], k[LENS + 7]
    slope = 2.0 * k1 + (4.0 * k2) * (u * u + v * v)
    xuu = 3.0 * slope * u + (8.0 * k2) * u * u * u + 6.0 * p2
    xuv = slope * v + (8.0 * k2) * u * u * v + 2.0 * p1
    xvv = slope * u + (8.0 * k2) * u * v * v + 2.0 * p2
    yvv = 3.0 * slope * v + (8.0 * k2) * v * v * v + 6.0 * p1
    return xuu, xuv, xvv, yvv


@inlined
def _quat_gradient(g, w, x, y, z):
    """d loss / d quaternion from d loss / d rotation matrix (row-major), through the normalisation."""
    inverse = 1.0 / root(w * w + x * x + y * y + z * z)
    w, x, y, z = w * inverse, x * inverse, y * inverse, z * inverse
    gw = 2.0 * (x * (g[7] - g[5]) + y * (g[2] - g[6]) + z * (g[3] - g[1]))
    gx = 2.0 * (w * (g[7] - g[5]) + y * (g[1] + g[3]) + z * (g[2] + g[6]) - 2.0 * x * (g[4] + g[8]))
    gy = 2.0 * (w * (g[2] - g[6]) + x * (g[1] + g[3]) + z * (g[5] + g[7]) - 2.0 * y * (g[0] + g[8]))
    gz = 2.0 * (w * (g[3] - g[1]) + x * (g[2] + g[6]) + y * (g[5] + g[7]) - 2.0 * z * (g[0] + g[4]))
    along = gw * w + gx * x + gy * y + gz * z
    return (
        (gw - along * w) * inverse,
        (gx - along * x) * inverse,
        (gy - along * y) * inverse,
        (gz - along * z) * inverse,
    )


@inlined
def _whitened_root(m, blur, determinant):
    """C^-1 M [2, 3], C = M M^T + blur, from the minors of M: the entries of C^-1 would cancel in a needle."""
    m0, m1, m2, n0, n1, n2 = m
    p, q, s = m0 * n1 - m1 * n0, m0 * n2 - m2 * n0, m1 * n2 - m2 * n1
    inverse = 1.0 / determinant
    return (
        inverse * (p * n1 + q * n2 + blur * m0),
        inverse * (s * n2 - p * n0 + blur * m1),
        inverse * (blur * m2 - q * n0 - s * n1),
        inverse * (blur * n0 - p * m1 - q * m2),
        inverse * (p * m0 - s * m2 + blur * n1),
        inverse * (q * m0 + s * m1 + blur * n2),
    )


@inlined
def _ellipse_gradient(moments, m, blur):
    """d loss / d mean2d (2) and the rows of d loss / d M (3 each)."""
    a, b, c, determinant = covariance(m, blur)
    ia, ib, ic = c / determinant, minus(b) / determinant, a / determinant
    # q = d^T C^-1 d: dq/dmean = -2 C^-1 d, dq/dC = -(C^-1 d)(C^-1 d)^T; alpha falls as exp(-q / 2), and
    # d loss / d M = 2 (d loss / d C) M.
    mx, my = load(moments, 8), load(moments, 16)
    mxx, mxy, myy = load(moments, 24), load(moments, 32), load(moments, 40)
    r0, r1, r2, s0, s1, s2 = _whitened_root(m, blur, determinant)
    x0, x1, x2 = mxx * r0 + mxy * s0, mxx * r1 + mxy * s1, mxx * r2 + mxy * s2
    y0, y1, y2 = mxy * r0 + myy * s0, mxy * r1 + myy * s1, mxy * r2 + myy * s2
    return (
        (ia * mx + ib * my, ib * mx + ic * my),
        (ia * x0 + ib * y0, ia * x1 + ib * y1, ia * x2 + ib * y2),
        (ib * x0 + ic * y0, ib * x1 + ic * y1, ib * x2 + ic * y2),
    )


@inlined
def _axes_gradient(p, q, r):
    """d loss / d A [2, 3] from d loss / d M, rows p and q already times the scales: dM (R S)^T."""
    a0, b0 = p[0] * r[0] + p[1] * r[1] + p[2] * r[2], q[0] * r[0] + q[1] * r[1] + q[2] * r[2]
    a1, b1 = p[0] * r[3] + p[1] * r[4] + p[2] * r[5], q[0] * r[3] + q[1] * r[4] + q[2] * r[5]
    a2, b2 = p[0] * r[6] + p[1] * r[7] + p[2] * r[8], q[0] * r[6] + q[1] * r[7] + q[2] * r[8]
    return a0, a1, a2, b0, b1, b2


@inlined
def _jacobian_gradient(outer, k):
    """d loss / d J [2, 3] from d loss / d A, A = J W: dA W^T."""
    a0, a1, a2, b0, b1, b2 = outer
    return (
        a0 * k[0] + a1 * k[1] + a2 * k[2],
        a0 * k[3] + a1 * k[4] + a2 * k[5],
        a0 * k[6] + a1 * k[7] + a2 * k[8],
        b0 * k[0] + b1 * k[1] + b2 * k[2],
        b0 * k[3] + b1 * k[4] + b2 * k[5],
        b0 * k[6] + b1 * k[7] + b2 * k[8],
    )


@inlined
def _point_gradient(jacobian, centre, tangents, lens, k, fisheye):
    """d loss / d camera point from d loss / d J and d loss / d mean2d; J = E [I, -(uc, vc)] / z."""
    j00, j01, j02, j10, j11, j12 = jacobian
    u, v, uc, vc, inverse = tangents
    e00, e01, e10, e11 = lens
    fx, fy = k[LENS], k[LENS + 1]
    d00, d01, d10, d11 = j00 - uc * j02, j01 - vc * j02, j10 - uc * j12, j11 - vc * j12
    # J is proportional to 1 / z.
    g_inverse = e00 * d00 + e01 * d01 + e10 * d10 + e11 * d11
    xuu, xuv, xvv, yvv = _lens_curvature(uc, vc, k, fisheye)
    guc = fx * (d00 * xuu + d01 * xuv) + fy * (d10 * xuv + d11 * xvv) - (j02 * e00 + j12 * e10)
    gvc = fx * (d00 * xuv + d01 * xvv) + fy * (d10 * xvv + d11 * yvv) - (j02 * e01 + j12 * e11)
    _, _, xu, xv, yv = distort(u, v, k, fisheye)
    gx, gy = centre
    free_u = both(at_least(u, k[BOUNDS]), at_least(k[BOUNDS + 1], u))
    free_v = both(at_least(v, k[BOUNDS + 2]), at_least(k[BOUNDS + 3], v))
    gu = (fx * xu) * gx + (fy * xv) * gy + choose(free_u, inverse * guc, 0.0)
    gv = (fx * xv) * gx + (fy * yv) * gy + choose(free_v, inverse * gvc, 0.0)
    depth = minus(inverse * (u * gu + v * gv + inverse * g_inverse))
    return inverse * gu, inverse * gv, depth


@inlined
def _backward_eight(values, moments, k, fisheye, out, counted, sums, view):
    """Fill out float64 [_OUTPUTS * 8] from the Gaussians and their moments.

    And `add_view` to the sums, unless view is None: then the compiler leaves that out.
    """
    x, y, z = to_camera(load(values, 0), load(values, 8), load(values, 16), k)
    axes, tangents, lens = screen_axes(x, y, z, k, fisheye)
    qw, qx, qy, qz = load(values, 24), load(values, 32), load(values, 40), load(values, 48)
    sx, sy, sz = load(values, 56), load(values, 64), load(values, 72)
    r = rotation(qw, qx, qy, qz)
    m = root_covariance(axes, r, sx, sy, sz)
    centre, p, q = _ellipse_gradient(moments, m, k[LIMITS + 1])
    store(out, 88, centre[0])
    store(out, 96, centre[1])
    o = minimum(load(values, 80), k[LIMITS + 2])
    store(out, 80, choose(above(o, 0.0), load(moments, 0) / o, 0.0))

    # M = A R S.
    a0, a1, a2, b0, b1, b2 = axes
    # d loss / d (R S) = A^T dM, column by column; its columns dotted with R's give the scales.
    f0, f1, f2 = a0 * p[0] + b0 * q[0], a0 * p[1] + b0 * q[1], a0 * p[2] + b0 * q[2]
    f3, f4, f5 = a1 * p[0] + b1 * q[0], a1 * p[1] + b1 * q[1], a1 * p[2] + b1 * q[2]
    f6, f7, f8 = a2 * p[0] + b2 * q[0], a2 * p[1] + b2 * q[1], a2 * p[2] + b2 * q[2]
    store(out, 56, f0 * r[0] + f3 * r[3] + f6 * r[6])
    store(out, 64, f1 * r[1] + f4 * r[4] + f7 * r[7])
    store(out, 72, f2 * r[2] + f5 * r[5] + f8 * r[8])
    rotated = (f0 * sx, f1 * sy, f2 * sz, f3 * sx, f4 * sy, f5 * sz, f6 * sx, f7 * sy, f8 * sz)
    gw, gx, gy, gz = _quat_gradient(rotated, qw, qx, qy, qz)
    store(out, 24, gw)
    store(out, 32, gx)
    store(out, 40, gy)
    store(out, 48, gz)

    p, q = (p[0] * sx, p[1] * sy, p[2] * sz), (q[0] * sx, q[1] * sy, q[2] * sz)
    outer = _axes_gradient(p, q, r)
    jacobian = _jacobian_gradient(outer, k)
    x, y, z = _point_gradient(jacobian, centre, tangents, lens, k, fisheye)
    if view is not None:
        add_view(sums, values, counted, centre, (x, y, z), outer, jacobian, tangents, lens, k, fisheye)
    store(out, 0, k[0] * x + k[3] * y + k[6] * z)
    store(out, 8, k[1] * x + k[4] * y + k[7] * z)
    store(out, 16, k[2] * x + k[5] * y + k[8] * z)


@kernel
def project_backward(
    counter, means, quats, scales, opacities, colours, k, fisheye, projected, entries, across, slots,
    grad_means, grad_quats, grad_scales, grad_opacities, grad_colours, grad_screen, weight, view,
):  # fmt: skip
    """Gradients [N, ...] of all inputs, zero for Gaussians that were not drawn.

    slots: from `composite_backward`. grad_screen float32 [N, 2]: d loss / d mean2d; weight float32 [N]:
    largest blending weight. view float64 [tasks, VIEW], to be summed over the tasks: d loss / d (the first
    VIEW numbers of k); or None.
    """
    n = len(means)
    drawn, ids = np.empty(TASK, np.int64), np.empty(8, np.int64)
    values, moments, found = np.empty(INPUTS * 8), np.empty(MOMENTS * 8), np.empty(_OUTPUTS * 8)
    counted, sums = np.empty(8), np.empty(VIEW * 8)
    task = take_number(counter)
    while task * TASK < n:
        count = 0
        for i in range(task * TASK, min((task + 1) * TASK, n)):
            drawn[count] = i
            count += entries.number[i] > 0
            for a in range(3):
                grad_means[i, a] = grad_scales[i, a] = grad_colours[i, a] = 0.0
            for a in range(4):
                grad_quats[i, a] = 0.0
            grad_opacities[i] = grad_screen[i, 0] = grad_screen[i, 1] = weight[i] = 0.0
        if view is not None:
            clear_view(sums)
        for first in range(0, count, 8):
            for j in range(8):
                i = drawn[min(first + j, count - 1)]
                ids[j] = i
                weight[i] = _add_slots(
                    slots, entries.slot[i], entries.slot[i + 1], entries.tile, entries.start[i], across,
                    projected.shape[i, 0], projected.shape[i, 1], moments, j, grad_colours[i],
                )  # fmt: skip
                counted[j] = weight[i] if first + j < count else 0.0
            read_eight(means, quats, scales, opacities, colours, ids, values)
            _backward_eight(values, moments, k, fisheye, found, counted, sums, view)
            for j in range(8):
                i = ids[j]
                if weight[i] > 0.0:
                    for a in range(3):
                        grad_means[i, a] = found[8 * a + j]
                        grad_scales[i, a] = found[56 + 8 * a + j]
                    for a in range(4):
                        grad_quats[i, a] = found[24 + 8 * a + j]
                    grad_opacities[i] = found[80 + j]
                    grad_screen[i, 0], grad_screen[i, 1] = found[88 + j], found[96 + j]
        if view is not None:
            finish_view(sums, view, task)
        task = take_number(counter)
