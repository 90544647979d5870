# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project`: from sums over pixels to means, rotations, scales and opacities.

As there, in float64 and one thread a Gaussian.
"""

import triton
import triton.language as tl

from recon.splat.gpu.fisheye import radial as fisheye_radial
from recon.splat.gpu.geometry import (
    BOUNDS,
    LENS,
    LIMITS,
    covariance,
    distort,
    read_gaussian,
    root_covariance,
    rotation,
    screen_axes,
    to_camera,
)
from recon.splat.gpu.project_view import store_view
from recon.splat.gpu.slots import MOMENTS
from recon.splat.gpu.tuples import appended, read_parameters


@triton.jit
def _lens_curvature(u, v, k, FISHEYE: tl.constexpr):
    """Second derivatives of the distorted tangents: xuu, xuv, xvv = yuv, yvv (yuu = xuv)."""
    if FISHEYE:
        _, slope, curve = fisheye_radial(u * u + v * v, k)
        xuu, xuv = u * (3.0 * slope + curve * u * u), v * (slope + curve * u * u)
        xvv, yvv = u * (slope + curve * v * v), v * (3.0 * slope + curve * v * v)
    else:
        k1, k2, p1, p2 = k[LENS + 4], k[LENS + 5], k[LENS + 6], k[LENS + 7]
        slope = 2.0 * k1 + (4.0 * k2) * (u * u + v * v)
        xuu = 3.0 * slope * u + (8.0 * k2) * u * u * u + 6.0 * p2
        xuv = slope * v + (8.0 * k2) * u * u * v + 2.0 * p1
        xvv = slope * u + (8.0 * k2) * u * v * v + 2.0 * p2
        yvv = 3.0 * slope * v + (8.0 * k2) * v * v * v + 6.0 * p1
    return xuu, xuv, xvv, yvv


@triton.jit
def _quat_gradient(g, quat):
    """d loss / d quaternion from d loss / d rotation matrix (row-major), through the normalisation."""
    w, x, y, z = quat
    inverse = 1.0 / tl.sqrt(w * w + x * x + y * y + z * z)
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


@triton.jit
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


@triton.jit
def _ellipse_gradient(moments, m, blur):
    """d loss / d mean2d (2) and the rows of d loss / d M (3 each)."""
    a, b, c, determinant = covariance(m, blur)
    ia, ib, ic = c / determinant, -b / determinant, a / determinant
    # q = d^T C^-1 d: dq/dmean = -2 C^-1 d, dq/dC = -(C^-1 d)(C^-1 d)^T; alpha falls as exp(-q / 2), and
    # d loss / d M = 2 (d loss / d C) M.
    _, mx, my, mxx, mxy, myy = moments
    r0, r1, r2, s0, s1, s2 = _whitened_root(m, blur, determinant)
    x0, x1, x2 = mxx * r0 + mxy * s0, mxx * r1 + mxy * s1, mxx * r2 + mxy * s2
    y0, y1, y2 = mxy * r0 + myy * s0, mxy * r1 + myy * s1, mxy * r2 + myy * s2
    return (
        (ia * mx + ib * my, ib * mx + ic * my),
        (ia * x0 + ib * y0, ia * x1 + ib * y1, ia * x2 + ib * y2),
        (ib * x0 + ic * y0, ib * x1 + ic * y1, ib * x2 + ic * y2),
    )


@triton.jit
def _axes_gradient(p, q, r):
    """d loss / d A [2, 3] from d loss / d M, rows p and q already times the scales: dM (R S)^T."""
    return (
        p[0] * r[0] + p[1] * r[1] + p[2] * r[2],
        p[0] * r[3] + p[1] * r[4] + p[2] * r[5],
        p[0] * r[6] + p[1] * r[7] + p[2] * r[8],
        q[0] * r[0] + q[1] * r[1] + q[2] * r[2],
        q[0] * r[3] + q[1] * r[4] + q[2] * r[5],
        q[0] * r[6] + q[1] * r[7] + q[2] * r[8],
    )


@triton.jit
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


@triton.jit
def _point_gradient(jacobian, centre, tangents, lens, k, FISHEYE: tl.constexpr):
    """d loss / d camera point from d loss / d J and d loss / d mean2d; J = E [I, -(uc, vc)] / z."""
    j00, j01, j02, j10, j11, j12 = jacobian
    u, v, uc, vc, inverse = tangents
    e00, e01, e10, e11 = lens
    fx, fy = k[LENS], k[LENS + 1]
    d00, d01, d10, d11 = j00 - uc * j02, j01 - vc * j02, j10 - uc * j12, j11 - vc * j12
    # J is proportional to 1 / z.
    g_inverse = e00 * d00 + e01 * d01 + e10 * d10 + e11 * d11
    xuu, xuv, xvv, yvv = _lens_curvature(uc, vc, k, FISHEYE)
    guc = fx * (d00 * xuu + d01 * xuv) + fy * (d10 * xuv + d11 * xvv) - (j02 * e00 + j12 * e10)
    gvc = fx * (d00 * xuv + d01 * xvv) + fy * (d10 * xvv + d11 * yvv) - (j02 * e01 + j12 * e11)
    _, _, xu, xv, yv = distort(u, v, k, FISHEYE)
    gx, gy = centre
    free_u = (u >= k[BOUNDS]) & (u <= k[BOUNDS + 1])
    free_v = (v >= k[BOUNDS + 2]) & (v <= k[BOUNDS + 3])
    gu = (fx * xu) * gx + (fy * xv) * gy + tl.where(free_u, inverse * guc, 0.0)
    gv = (fx * xv) * gx + (fy * yv) * gy + tl.where(free_v, inverse * gvc, 0.0)
    depth = -(inverse * (u * gu + v * gv + inverse * g_inverse))
    return inverse * gu, inverse * gv, depth


@triton.jit
def _read_moments(pointer, touched):
    """The moments, zero where nothing was touched."""
    found = ()
    for a in tl.static_range(MOMENTS):
        found = appended(found, tl.load(pointer + a, mask=touched, other=0.0))
    return found


@triton.jit
def _store(pointer, value, touched, here):
    """A gradient in float32, zero where nothing was touched."""
    tl.store(pointer, tl.where(touched, value, 0.0).to(tl.float32), mask=here)


@triton.jit(do_not_specialize=["n"])
def project_backward(
    means, quats, scales, opacities, parameter, n, moments, weight,
    grad_means, grad_quats, grad_scales, grad_opacities, grad_screen, view,
    BLOCK: tl.constexpr, MOVING: tl.constexpr, FISHEYE: tl.constexpr,
):  # fmt: skip
    """Gradients float32 [N, ...] of all inputs but colours, zero for Gaussians that touched no pixel.

    moments and weight: from `add_slots`. grad_screen float32 [N, 2]: d loss / d mean2d. view float64
    [programs, VIEW], to be summed over the programs, if MOVING: d loss / d (the first VIEW parameters).
    """
    program = tl.program_id(0)
    i = program.to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = i < n
    touched = tl.load(weight + i, mask=here, other=0.0) > 0.0
    k = read_parameters(parameter)
    # Where nothing was touched, harmless numbers are computed with: what is stored there is zero.
    mean, quat, scale = read_gaussian(means, quats, scales, i, touched)
    x, y, z = to_camera(mean, k)
    x, y, z = tl.where(touched, x, 0.0), tl.where(touched, y, 0.0), tl.where(touched, z, 1.0)
    sums = _read_moments(moments + i * MOMENTS, touched)
    o = tl.load(opacities + i, mask=touched, other=1.0).to(tl.float64)
    axes, tangents, lens = screen_axes(x, y, z, k, FISHEYE)
    r = rotation(quat)
    m = root_covariance(axes, r, scale)
    centre, p, q = _ellipse_gradient(sums, m, k[LIMITS + 1])
    _store(grad_screen + 2 * i, centre[0], touched, here)
    _store(grad_screen + 2 * i + 1, centre[1], touched, here)
    _store(grad_opacities + i, sums[0] / tl.minimum(o, k[LIMITS + 2]), touched, here)

    # M = A R S.
    a0, a1, a2, b0, b1, b2 = axes
    # d loss / d (R S) = A^T dM, column by column; its columns dotted with R's give the scales.
    f0, f1, f2 = a0 * p[0] + b0 * q[0], a0 * p[1] + b0 * q[1], a0 * p[2] + b0 * q[2]
    f3, f4, f5 = a1 * p[0] + b1 * q[0], a1 * p[1] + b1 * q[1], a1 * p[2] + b1 * q[2]
    f6, f7, f8 = a2 * p[0] + b2 * q[0], a2 * p[1] + b2 * q[1], a2 * p[2] + b2 * q[2]
    _store(grad_scales + 3 * i, f0 * r[0] + f3 * r[3] + f6 * r[6], touched, here)
    _store(grad_scales + 3 * i + 1, f1 * r[1] + f4 * r[4] + f7 * r[7], touched, here)
    _store(grad_scales + 3 * i + 2, f2 * r[2] + f5 * r[5] + f8 * r[8], touched, here)
    sx, sy, sz = scale
    rotated = (f0 * sx, f1 * sy, f2 * sz, f3 * sx, f4 * sy, f5 * sz, f6 * sx, f7 * sy, f8 * sz)
    gw, gx, gy, gz = _quat_gradient(rotated, quat)
    _store(grad_quats + 4 * i, gw, touched, here)
    _store(grad_quats + 4 * i + 1, gx, touched, here)
    _store(grad_quats + 4 * i + 2, gy, touched, here)
    _store(grad_quats + 4 * i + 3, gz, touched, here)

    p, q = (p[0] * sx, p[1] * sy, p[2] * sz), (q[0] * sx, q[1] * sy, q[2] * sz)
    outer = _axes_gradient(p, q, r)
    jacobian = _jacobian_gradient(outer, k)
    x, y, z = _point_gradient(jacobian, centre, tangents, lens, k, FISHEYE)
    _store(grad_means + 3 * i, k[0] * x + k[3] * y + k[6] * z, touched, here)
    _store(grad_means + 3 * i + 1, k[1] * x + k[4] * y + k[7] * z, touched, here)
    _store(grad_means + 3 * i + 2, k[2] * x + k[5] * y + k[8] * z, touched, here)
    if MOVING:
        point = (x, y, z)
        store_view(view, program, touched, mean, centre, point, outer, jacobian, tangents, lens, k, FISHEYE)
