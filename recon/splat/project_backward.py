# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project`: from sums over pixels to means, rotations, scales and opacities."""

import numpy as np

from recon.jit import kernel
from recon.splat.composite_backward import SLOT
from recon.splat.project import (
    BOUNDS,
    LENS,
    LIMITS,
    covariance,
    distort,
    root_covariance,
    rotation,
    screen_axes,
)
from recon.splat.tiles import TASK, TILE
from recon.threads import take_number


@kernel
def _lens_curvature(u, v, k):
    """Second derivatives of the distorted tangents: xuu, xuv, xvv = yuv, yvv (yuu = xuv)."""
    k1, k2, p1, p2 = k[LENS + 4], k[LENS + 5], k[LENS + 6], k[LENS + 7]
    slope = 2.0 * k1 + 4.0 * k2 * (u * u + v * v)
    xuu = 3.0 * slope * u + 8.0 * k2 * u * u * u + 6.0 * p2
    xuv = slope * v + 8.0 * k2 * u * u * v + 2.0 * p1
    xvv = slope * u + 8.0 * k2 * u * v * v + 2.0 * p2
    yvv = 3.0 * slope * v + 8.0 * k2 * v * v * v + 6.0 * p1
    return xuu, xuv, xvv, yvv


@kernel
def _moments(slots, first, last, tile, entry, tiles_x, px, py):
    """Sums over a Gaussian's slots, in their order, of s, s d, s d d^T (d: pixel minus mean), w g; max w."""
    s = sx = sy = sxx = sxy = syy = red = green = blue = peak = 0.0
    for slot in range(first, last):
        t = tile[entry + slot - first]
        ox = (t % tiles_x) * TILE + 0.5 * TILE - px
        oy = (t // tiles_x) * TILE + 0.5 * TILE - py
        at = SLOT * slot
        m = np.float64(slots[at])
        mx, my = np.float64(slots[at + 1]), np.float64(slots[at + 2])
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
    return (s, sx, sy, sxx, sxy, syy), (red, green, blue), peak


@kernel
def _quat_gradient(g, unit, norm):
    """d loss / d quaternion from d loss / d rotation matrix (row-major), through the normalisation."""
    w, x, y, z = unit
    gw = 2.0 * (x * (g[7] - g[5]) + y * (g[2] - g[6]) + z * (g[3] - g[1]))
    gx = 2.0 * (w * (g[7] - g[5]) + y * (g[1] + g[3]) + z * (g[2] + g[6]) - 2.0 * x * (g[4] + g[8]))
    gy = 2.0 * (w * (g[2] - g[6]) + x * (g[1] + g[3]) + z * (g[5] + g[7]) - 2.0 * y * (g[0] + g[8]))
    gz = 2.0 * (w * (g[3] - g[1]) + x * (g[2] + g[6]) + y * (g[5] + g[7]) - 2.0 * z * (g[0] + g[4]))
    along = gw * w + gx * x + gy * y + gz * z
    return (gw - along * w) / norm, (gx - along * x) / norm, (gy - along * y) / norm, (gz - along * z) / norm


@kernel
def _backward_one(mean, quat, scale, opacity, k, moments, grad_mean, grad_quat, grad_scale):
    """Fill a Gaussian's gradients; returns d loss / d mean2d (x, y) and d loss / d opacity."""
    wx, wy, wz = np.float64(mean[0]), np.float64(mean[1]), np.float64(mean[2])
    x = k[0] * wx + k[1] * wy + k[2] * wz + k[9]
    y = k[3] * wx + k[4] * wy + k[5] * wz + k[10]
    z = k[6] * wx + k[7] * wy + k[8] * wz + k[11]
    axes, tangents, lens = screen_axes(x, y, z, k)
    r, unit, norm = rotation(
        np.float64(quat[0]), np.float64(quat[1]), np.float64(quat[2]), np.float64(quat[3])
    )
    sx, sy, sz = np.float64(scale[0]), np.float64(scale[1]), np.float64(scale[2])
    m = root_covariance(axes, r, sx, sy, sz)
    a, b, c, determinant = covariance(m, k[LIMITS + 1])
    ia, ib, ic = c / determinant, -b / determinant, a / determinant

    # q = d^T C^-1 d: dq/dmean = -2 C^-1 d, dq/dC = -(C^-1 d)(C^-1 d)^T; alpha falls as exp(-q / 2).
    s, m1x, m1y, mxx, mxy, myy = moments
    gx, gy = ia * m1x + ib * m1y, ib * m1x + ic * m1y
    h00, h01 = ia * mxx + ib * mxy, ia * mxy + ib * myy
    h10, h11 = ib * mxx + ic * mxy, ib * mxy + ic * myy
    ga = 0.5 * (h00 * ia + h01 * ib)
    gb = 0.5 * (h00 * ib + h01 * ic)
    gc = 0.5 * (h10 * ib + h11 * ic)
    grad_opacity = 0.0
    if opacity <= k[LIMITS + 2] and opacity > 0.0:
        grad_opacity = s / np.float64(opacity)

    # C = M M^T + blur: d loss / d M = 2 G M, M = A R S.
    p0, p1, p2 = 2.0 * (ga * m[0] + gb * m[3]), 2.0 * (ga * m[1] + gb * m[4]), 2.0 * (ga * m[2] + gb * m[5])
    q0, q1, q2 = 2.0 * (gb * m[0] + gc * m[3]), 2.0 * (gb * m[1] + gc * m[4]), 2.0 * (gb * m[2] + gc * m[5])
    a0, a1, a2, b0, b1, b2 = axes
    # d loss / d (R S) = A^T dM, column by column; its columns dotted with R's give the scales.
    f0, f1, f2 = a0 * p0 + b0 * q0, a0 * p1 + b0 * q1, a0 * p2 + b0 * q2
    f3, f4, f5 = a1 * p0 + b1 * q0, a1 * p1 + b1 * q1, a1 * p2 + b1 * q2
    f6, f7, f8 = a2 * p0 + b2 * q0, a2 * p1 + b2 * q1, a2 * p2 + b2 * q2
    grad_scale[0] = f0 * r[0] + f3 * r[3] + f6 * r[6]
    grad_scale[1] = f1 * r[1] + f4 * r[4] + f7 * r[7]
    grad_scale[2] = f2 * r[2] + f5 * r[5] + f8 * r[8]
    rotated = (f0 * sx, f1 * sy, f2 * sz, f3 * sx, f4 * sy, f5 * sz, f6 * sx, f7 * sy, f8 * sz)
    grad_quat[0], grad_quat[1], grad_quat[2], grad_quat[3] = _quat_gradient(rotated, unit, norm)

    # d loss / d A = dM (R S)^T, then A = J W and J = E [I, -(uc, vc)] / z with E the lens at (uc, vc).
    p0, p1, p2, q0, q1, q2 = p0 * sx, p1 * sy, p2 * sz, q0 * sx, q1 * sy, q2 * sz
    da0, da1, da2 = (
        p0 * r[0] + p1 * r[1] + p2 * r[2],
        p0 * r[3] + p1 * r[4] + p2 * r[5],
        p0 * r[6] + p1 * r[7] + p2 * r[8],
    )
    db0, db1, db2 = (
        q0 * r[0] + q1 * r[1] + q2 * r[2],
        q0 * r[3] + q1 * r[4] + q2 * r[5],
        q0 * r[6] + q1 * r[7] + q2 * r[8],
    )
    j00, j01, j02 = (
        da0 * k[0] + da1 * k[1] + da2 * k[2],
        da0 * k[3] + da1 * k[4] + da2 * k[5],
        da0 * k[6] + da1 * k[7] + da2 * k[8],
    )
    j10, j11, j12 = (
        db0 * k[0] + db1 * k[1] + db2 * k[2],
        db0 * k[3] + db1 * k[4] + db2 * k[5],
        db0 * k[6] + db1 * k[7] + db2 * k[8],
    )
    u, v, uc, vc = tangents
    e00, e01, e10, e11 = lens
    inverse = 1.0 / z
    d00, d01 = inverse * (j00 - uc * j02), inverse * (j01 - vc * j02)
    d10, d11 = inverse * (j10 - uc * j12), inverse * (j11 - vc * j12)
    fx, fy = k[LENS], k[LENS + 1]
    xuu, xuv, xvv, yvv = _lens_curvature(uc, vc, k)
    guc = fx * (d00 * xuu + d01 * xuv) + fy * (d10 * xuv + d11 * xvv) - inverse * (j02 * e00 + j12 * e10)
    gvc = fx * (d00 * xuv + d01 * xvv) + fy * (d10 * xvv + d11 * yvv) - inverse * (j02 * e01 + j12 * e11)
    # J is proportional to 1 / z: d loss / d (1 / z) = z (dJ . J), taken as dJ . (E [I, -(uc, vc)]).
    g_inverse = (
        e00 * (j00 - uc * j02) + e01 * (j01 - vc * j02) + e10 * (j10 - uc * j12) + e11 * (j11 - vc * j12)
    )
    _, _, xu, xv, yv = distort(u, v, k)
    gu = fx * xu * gx + fy * xv * gy
    gv = fx * xv * gx + fy * yv * gy
    if k[BOUNDS] <= u and u <= k[BOUNDS + 1]:
        gu += guc
    if k[BOUNDS + 2] <= v and v <= k[BOUNDS + 3]:
        gv += gvc
    cx, cy = inverse * gu, inverse * gv
    cz = -inverse * (u * gu + v * gv) - inverse * inverse * g_inverse
    grad_mean[0] = k[0] * cx + k[3] * cy + k[6] * cz
    grad_mean[1] = k[1] * cx + k[4] * cy + k[7] * cz
    grad_mean[2] = k[2] * cx + k[5] * cy + k[8] * cz
    return gx, gy, grad_opacity


@kernel
def project_backward(
    counter, means, quats, scales, opacities, k, projected, entries, across, slots,
    grad_means, grad_quats, grad_scales, grad_opacities, grad_colours, grad_screen, weight,
):  # fmt: skip
    """Gradients [N, ...] of all inputs, zero for Gaussians that were not drawn.

    slots: from `composite_backward`. grad_screen float32 [N, 2]: d loss / d mean2d; weight float32 [N]:
    largest blending weight.
    """
    n = len(means)
    task = take_number(counter)
    while task * TASK < n:
        for i in range(task * TASK, min((task + 1) * TASK, n)):
            for j in range(3):
                grad_means[i, j] = grad_scales[i, j] = grad_colours[i, j] = 0.0
            for j in range(4):
                grad_quats[i, j] = 0.0
            grad_opacities[i] = grad_screen[i, 0] = grad_screen[i, 1] = weight[i] = 0.0
            if entries.number[i] == 0:
                continue
            shape = projected.shape[i]
            moments, colour, peak = _moments(
                slots, entries.slot[i], entries.slot[i + 1], entries.tile, entries.start[i], across,
                shape[0], shape[1],
            )  # fmt: skip
            weight[i] = peak
            grad_colours[i, 0], grad_colours[i, 1], grad_colours[i, 2] = colour
            if peak > 0.0:
                grad_screen[i, 0], grad_screen[i, 1], grad_opacities[i] = _backward_one(
                    means[i], quats[i], scales[i], opacities[i], k, moments,
                    grad_means[i], grad_quats[i], grad_scales[i],
                )  # fmt: skip
        task = take_number(counter)
