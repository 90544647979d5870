# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""From a Gaussian in the world to an ellipse in the image: the forward half of EWA splatting.

Computed in float64, a Gaussian at a time: it is a small part of the work, and positions in pixels and
the covariances of needles need more digits than float32 has.
"""

import math

import numpy as np

from recon.jit import kernel
from recon.splat.camera import Floats, SplatCamera
from recon.splat.limits import ALPHA_FLOOR, QUAT_LEAST, Limits
from recon.splat.tables import BAD, DRAWN, SKIPPED
from recon.splat.tiles import TASK
from recon.threads import take_number

LENS = 12
"""Index in the parameter vector of fx fy cx cy k1 k2 p1 p2; before it rotation (9) and translation (3)."""
BOUNDS = 20
"""Index of u_min u_max v_min v_max, the clamp of the Jacobian, then the squared monotone radius."""
LIMITS = 25
"""Index of near, blur, alpha_max, alpha_min, tau * luminance_reference (or inf), max_sigma^2."""

FOLD = math.sqrt(0.5 / math.log(2.0))
"""Whitened coordinates times this: exp(-(x^2 + y^2) / 2) = 2^-((FOLD x)^2 + (FOLD y)^2)."""


def parameters(camera: SplatCamera, limits: Limits) -> Floats:
    """All that the projection needs to know of camera and limits, as float64 [31]."""
    motion = np.asarray(camera.cam_from_world, np.float64)
    reference = limits.luminance_reference
    return np.array(
        [
            *motion[:3, :3].ravel(),
            *motion[:3, 3],
            *(camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2),
            *camera.tangent_bounds(limits.tangent_margin),
            camera.monotone_radius2,
            *(limits.near, limits.blur, limits.alpha_max, limits.alpha_min),
            math.inf if reference is None else limits.tau * reference,
            limits.max_sigma**2,
        ]
    )


@kernel
def distort(u, v, k):
    """Distorted tangents and their derivatives: x, y, dx/du, dx/dv = dy/du, dy/dv."""
    k1, k2, p1, p2 = k[LENS + 4], k[LENS + 5], k[LENS + 6], k[LENS + 7]
    r2 = u * u + v * v
    radial = 1.0 + r2 * (k1 + r2 * k2)
    slope = 2.0 * k1 + 4.0 * k2 * r2
    x = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u)
    y = v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v
    xu = radial + slope * u * u + 2.0 * p1 * v + 6.0 * p2 * u
    yv = radial + slope * v * v + 6.0 * p1 * v + 2.0 * p2 * u
    xv = slope * u * v + 2.0 * p1 * u + 2.0 * p2 * v
    return x, y, xu, xv, yv


@kernel
def rotation(qw, qx, qy, qz):
    """Rotation matrix of a quaternion, row-major, and the unit quaternion with the norm it had."""
    largest = max(max(abs(qw), abs(qx)), max(abs(qy), abs(qz)))
    w, x, y, z = qw / largest, qx / largest, qy / largest, qz / largest
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    matrix = (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )
    return matrix, (w, x, y, z), norm * largest


@kernel
def screen_axes(x, y, z, k):
    """A = J W [2, 3]: how a small world offset moves the projection, at a camera point, px per unit.

    Also the tangents u, v, the clamped ones, and the derivative E of the lens at the clamped ones.
    """
    inverse = 1.0 / z
    u, v = x * inverse, y * inverse
    uc = min(max(u, k[BOUNDS]), k[BOUNDS + 1])
    vc = min(max(v, k[BOUNDS + 2]), k[BOUNDS + 3])
    _, _, xu, xv, yv = distort(uc, vc, k)
    fx, fy = k[LENS], k[LENS + 1]
    e00, e01, e10, e11 = fx * xu, fx * xv, fy * xv, fy * yv
    j00, j01, j02 = inverse * e00, inverse * e01, -inverse * (e00 * uc + e01 * vc)
    j10, j11, j12 = inverse * e10, inverse * e11, -inverse * (e10 * uc + e11 * vc)
    axes = (
        j00 * k[0] + j01 * k[3] + j02 * k[6],
        j00 * k[1] + j01 * k[4] + j02 * k[7],
        j00 * k[2] + j01 * k[5] + j02 * k[8],
        j10 * k[0] + j11 * k[3] + j12 * k[6],
        j10 * k[1] + j11 * k[4] + j12 * k[7],
        j10 * k[2] + j11 * k[5] + j12 * k[8],
    )
    return axes, (u, v, uc, vc), (e00, e01, e10, e11)


@kernel
def root_covariance(axes, r, sx, sy, sz):
    """M = A R S [2, 3], whose M M^T is the projected covariance before blur."""
    a0, a1, a2, b0, b1, b2 = axes
    return (
        (a0 * r[0] + a1 * r[3] + a2 * r[6]) * sx,
        (a0 * r[1] + a1 * r[4] + a2 * r[7]) * sy,
        (a0 * r[2] + a1 * r[5] + a2 * r[8]) * sz,
        (b0 * r[0] + b1 * r[3] + b2 * r[6]) * sx,
        (b0 * r[1] + b1 * r[4] + b2 * r[7]) * sy,
        (b0 * r[2] + b1 * r[5] + b2 * r[8]) * sz,
    )


@kernel
def covariance(m, blur):
    """Entries a, b, c of M M^T + blur I and its determinant, without cancellation (Cauchy-Binet)."""
    m0, m1, m2, n0, n1, n2 = m
    a = m0 * m0 + m1 * m1 + m2 * m2
    b = m0 * n0 + m1 * n1 + m2 * n2
    c = n0 * n0 + n1 * n1 + n2 * n2
    p, q, s = m0 * n1 - m1 * n0, m0 * n2 - m2 * n0, m1 * n2 - m2 * n1
    determinant = p * p + q * q + s * s + blur * (a + c) + blur * blur
    return a + blur, b, c + blur, determinant


@kernel
def _finite(value):
    return abs(value) < math.inf


@kernel
def _project_one(mean, quat, scale, opacity, colour, k, shape, paint, box):
    """Fill a Gaussian's rows of Projected; returns (state, depth, radius)."""
    good = _finite(opacity) and opacity >= 0.0
    for i in range(3):
        good = good and _finite(mean[i]) and _finite(scale[i]) and scale[i] > 0.0 and _finite(colour[i])
    turned = False
    for i in range(4):
        good = good and _finite(quat[i])
        turned = turned or abs(quat[i]) >= QUAT_LEAST
    if not (good and turned):
        return BAD, 0.0, 0.0

    wx, wy, wz = np.float64(mean[0]), np.float64(mean[1]), np.float64(mean[2])
    x = k[0] * wx + k[1] * wy + k[2] * wz + k[9]
    y = k[3] * wx + k[4] * wy + k[5] * wz + k[10]
    z = k[6] * wx + k[7] * wy + k[8] * wz + k[11]
    if not z >= k[LIMITS]:
        return SKIPPED, 0.0, 0.0
    axes, tangents, _ = screen_axes(x, y, z, k)
    u, v = tangents[0], tangents[1]
    if not u * u + v * v < k[BOUNDS + 4]:
        return SKIPPED, 0.0, 0.0
    matrix, _, _ = rotation(
        np.float64(quat[0]), np.float64(quat[1]), np.float64(quat[2]), np.float64(quat[3])
    )
    m = root_covariance(axes, matrix, np.float64(scale[0]), np.float64(scale[1]), np.float64(scale[2]))
    a, b, c, determinant = covariance(m, k[LIMITS + 1])
    if not (max(a, c) <= k[LIMITS + 5] and determinant < math.inf):
        return BAD, 0.0, 0.0

    brightest = max(max(np.float64(colour[0]), np.float64(colour[1])), np.float64(colour[2]))
    floor = k[LIMITS + 3]
    if brightest > 0.0:
        floor = min(floor, k[LIMITS + 4] / brightest)
    floor = max(floor, ALPHA_FLOOR)
    o = min(np.float64(opacity), k[LIMITS + 2])
    if not o >= floor:
        return SKIPPED, 0.0, 0.0
    reach = math.log2(o / floor)

    # q = (m11 dx)^2 + (m21 dx + m22 dy)^2 with the factor FOLD^2; the ellipse is q <= reach.
    m11 = FOLD / math.sqrt(a)
    m22 = FOLD * math.sqrt(a / determinant)
    m21 = -FOLD * b / math.sqrt(a * determinant)
    dx, dy, _, _, _ = distort(u, v, k)
    px, py = k[LENS] * dx + k[LENS + 2], k[LENS + 1] * dy + k[LENS + 3]
    rx = math.sqrt(reach * a) / FOLD
    ry = math.sqrt(reach * c) / FOLD
    width, height = box[2], box[3]
    first_x = math.ceil(max(px - rx - 0.5, 0.0))
    last_x = math.floor(min(px + rx - 0.5, width - 1.0))
    first_y = math.ceil(max(py - ry - 0.5, 0.0))
    last_y = math.floor(min(py + ry - 0.5, height - 1.0))
    if not (first_x <= last_x and first_y <= last_y):
        return SKIPPED, 0.0, 0.0
    box[0], box[1], box[2], box[3] = first_x, last_x, first_y, last_y
    shape[0], shape[1], shape[2], shape[3], shape[4], shape[5] = px, py, m11, m21, m22, reach
    paint[0], paint[1], paint[2] = colour[0], colour[1], colour[2]
    paint[3], paint[4] = o, -reach
    middle = 0.5 * (a + c)
    spread = math.sqrt(max(0.25 * (a - c) * (a - c) + b * b, 0.0))
    return DRAWN, z, 3.0 * math.sqrt(middle + spread)


@kernel
def project(counter, means, quats, scales, opacities, colours, k, width, height, out):
    """Project N Gaussians; float32 inputs as in `rasterize`, k from `parameters`, out: Projected."""
    n = len(means)
    task = take_number(counter)
    while task * TASK < n:
        for i in range(task * TASK, min((task + 1) * TASK, n)):
            out.box[i, 2], out.box[i, 3] = width, height
            out.state[i], out.depth[i], out.radius[i] = _project_one(
                means[i], quats[i], scales[i], opacities[i], colours[i], k,
                out.shape[i], out.paint[i], out.box[i],
            )  # fmt: skip
        task = take_number(counter)
