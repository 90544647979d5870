# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The formulas of the projection, shared by its forward and its backward kernel, in float64.

`k` is the vector of `recon.splat.parameters`, read once (see `tuples`). Brown's lens and the fisheye have
kernels each: FISHEYE is known when they are compiled.
"""

import triton
import triton.language as tl

from recon.splat import parameters
from recon.splat.gpu.fisheye import radial as fisheye_radial

LENS = tl.constexpr(parameters.LENS)
BOUNDS = tl.constexpr(parameters.BOUNDS)
LIMITS = tl.constexpr(parameters.LIMITS)


@triton.jit
def read_gaussian(means, quats, scales, i, here):
    """Mean, quaternion and scale of Gaussians i in float64; harmless ones where not `here`."""
    x = tl.load(means + 3 * i, mask=here, other=0.0).to(tl.float64)
    y = tl.load(means + 3 * i + 1, mask=here, other=0.0).to(tl.float64)
    z = tl.load(means + 3 * i + 2, mask=here, other=0.0).to(tl.float64)
    qw = tl.load(quats + 4 * i, mask=here, other=1.0).to(tl.float64)
    qx = tl.load(quats + 4 * i + 1, mask=here, other=0.0).to(tl.float64)
    qy = tl.load(quats + 4 * i + 2, mask=here, other=0.0).to(tl.float64)
    qz = tl.load(quats + 4 * i + 3, mask=here, other=0.0).to(tl.float64)
    sx = tl.load(scales + 3 * i, mask=here, other=1.0).to(tl.float64)
    sy = tl.load(scales + 3 * i + 1, mask=here, other=1.0).to(tl.float64)
    sz = tl.load(scales + 3 * i + 2, mask=here, other=1.0).to(tl.float64)
    return (x, y, z), (qw, qx, qy, qz), (sx, sy, sz)


@triton.jit
def to_camera(mean, k):
    """World to camera coordinates."""
    x, y, z = mean
    return (
        k[0] * x + k[1] * y + k[2] * z + k[9],
        k[3] * x + k[4] * y + k[5] * z + k[10],
        k[6] * x + k[7] * y + k[8] * z + k[11],
    )


@triton.jit
def distort(u, v, k, FISHEYE: tl.constexpr):
    """Distorted tangents and their derivatives: x, y, dx/du, dx/dv = dy/du, dy/dv."""
    uu, vv, uv = u * u, v * v, u * v
    r2 = uu + vv
    if FISHEYE:
        radial, slope, _ = fisheye_radial(r2, k)
        x, y = u * radial, v * radial
        xu, xv, yv = radial + slope * uu, slope * uv, radial + slope * vv
    else:
        k1, k2, p1, p2 = k[LENS + 4], k[LENS + 5], k[LENS + 6], k[LENS + 7]
        radial = 1.0 + r2 * (k1 + r2 * k2)
        slope = 2.0 * k1 + (4.0 * k2) * r2
        x = u * radial + (2.0 * p1) * uv + p2 * (r2 + 2.0 * uu)
        y = v * radial + p1 * (r2 + 2.0 * vv) + (2.0 * p2) * uv
        xu = radial + slope * uu + (2.0 * p1) * v + (6.0 * p2) * u
        yv = radial + slope * vv + (6.0 * p1) * v + (2.0 * p2) * u
        xv = slope * uv + (2.0 * p1) * u + (2.0 * p2) * v
    return x, y, xu, xv, yv


@triton.jit
def rotation(quat):
    """Rotation matrix, row-major, of a quaternion of any length."""
    w, x, y, z = quat
    s = 2.0 / (w * w + x * x + y * y + z * z)
    xx, yy, zz = s * x * x, s * y * y, s * z * z
    xy, xz, yz = s * x * y, s * x * z, s * y * z
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    return (
        (1.0 - yy) - zz,
        xy - wz,
        xz + wy,
        xy + wz,
        (1.0 - xx) - zz,
        yz - wx,
        xz - wy,
        yz + wx,
        (1.0 - xx) - yy,
    )


@triton.jit
def screen_axes(x, y, z, k, FISHEYE: tl.constexpr):
    """A = J W [2, 3]: how a small world offset moves the projection, at a camera point, px per unit.

    Also the tangents u, v, the clamped ones, 1 / z, and the derivative E of the lens at the clamped ones.
    """
    inverse = 1.0 / z
    u, v = x * inverse, y * inverse
    uc = tl.minimum(tl.maximum(u, k[BOUNDS]), k[BOUNDS + 1])
    vc = tl.minimum(tl.maximum(v, k[BOUNDS + 2]), k[BOUNDS + 3])
    _, _, xu, xv, yv = distort(uc, vc, k, FISHEYE)
    fx, fy = k[LENS], k[LENS + 1]
    e00, e01, e10, e11 = fx * xu, fx * xv, fy * xv, fy * yv
    j00, j01, j02 = inverse * e00, inverse * e01, -(inverse * (e00 * uc + e01 * vc))
    j10, j11, j12 = inverse * e10, inverse * e11, -(inverse * (e10 * uc + e11 * vc))
    axes = (
        j00 * k[0] + j01 * k[3] + j02 * k[6],
        j00 * k[1] + j01 * k[4] + j02 * k[7],
        j00 * k[2] + j01 * k[5] + j02 * k[8],
        j10 * k[0] + j11 * k[3] + j12 * k[6],
        j10 * k[1] + j11 * k[4] + j12 * k[7],
        j10 * k[2] + j11 * k[5] + j12 * k[8],
    )
    return axes, (u, v, uc, vc, inverse), (e00, e01, e10, e11)


@triton.jit
def root_covariance(axes, r, scale):
    """M = A R S [2, 3], whose M M^T is the projected covariance before blur."""
    a0, a1, a2, b0, b1, b2 = axes
    sx, sy, sz = scale
    return (
        (a0 * r[0] + a1 * r[3] + a2 * r[6]) * sx,
        (a0 * r[1] + a1 * r[4] + a2 * r[7]) * sy,
        (a0 * r[2] + a1 * r[5] + a2 * r[8]) * sz,
        (b0 * r[0] + b1 * r[3] + b2 * r[6]) * sx,
        (b0 * r[1] + b1 * r[4] + b2 * r[7]) * sy,
        (b0 * r[2] + b1 * r[5] + b2 * r[8]) * sz,
    )


@triton.jit
def covariance(m, blur):
    """Entries a, b, c of M M^T + blur I and its determinant, without cancellation (Cauchy-Binet)."""
    m0, m1, m2, n0, n1, n2 = m
    a = m0 * m0 + m1 * m1 + m2 * m2
    b = m0 * n0 + m1 * n1 + m2 * n2
    c = n0 * n0 + n1 * n1 + n2 * n2
    p, q, s = m0 * n1 - m1 * n0, m0 * n2 - m2 * n0, m1 * n2 - m2 * n1
    determinant = p * p + q * q + s * s + blur * (a + c) + blur * blur
    return a + blur, b, c + blur, determinant
