# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project` by the camera: rotation and translation of cam_from_world, and the lens.

The formulas of `recon.splat.cpu.project_view`: a Gaussian reaches the image through its pixel mean f(lens,
P), P = W mean + t, and through the axes A = J(lens, P) W of its ellipse.
"""

import triton
import triton.language as tl

from recon.splat.gpu.fisheye import radial_by_terms
from recon.splat.gpu.geometry import LENS, distort
from recon.splat.moved import VIEW as _VIEW

VIEW = tl.constexpr(_VIEW)


@triton.jit
def _store(view, program, number: tl.constexpr, share, touched):
    tl.store(view + program * VIEW + number, tl.sum(tl.where(touched, share, 0.0), axis=0))


@triton.jit
def _tangent_slopes(u, v, FISHEYE: tl.constexpr):
    """Derivatives of the distorted tangents by the four terms of distortion: of x, then of y."""
    uu, vv, uv = u * u, v * v, u * v
    r2 = uu + vv
    if FISHEYE:
        by, _ = radial_by_terms(r2)
        by_x = (u * by[0], u * by[1], u * by[2], u * by[3])
        by_y = (v * by[0], v * by[1], v * by[2], v * by[3])
    else:
        by_x = (u * r2, u * r2 * r2, 2.0 * uv, r2 + 2.0 * uu)
        by_y = (v * r2, v * r2 * r2, r2 + 2.0 * vv, 2.0 * uv)
    return by_x, by_y


@triton.jit
def _lens_slopes(u, v, FISHEYE: tl.constexpr):
    """Derivatives of dx/du, dx/dv = dy/du and dy/dv by the four terms of distortion."""
    uu, vv, uv = u * u, v * v, u * v
    r2 = uu + vv
    if FISHEYE:
        by, turn = radial_by_terms(r2)
        by_xu = (by[0] + turn[0] * uu, by[1] + turn[1] * uu, by[2] + turn[2] * uu, by[3] + turn[3] * uu)
        by_xv = (turn[0] * uv, turn[1] * uv, turn[2] * uv, turn[3] * uv)
        by_yv = (by[0] + turn[0] * vv, by[1] + turn[1] * vv, by[2] + turn[2] * vv, by[3] + turn[3] * vv)
    else:
        by_xu = (r2 + 2.0 * uu, r2 * (r2 + 4.0 * uu), 2.0 * v, 6.0 * u)
        by_xv = (2.0 * uv, 4.0 * r2 * uv, 2.0 * u, 2.0 * v)
        by_yv = (r2 + 2.0 * vv, r2 * (r2 + 4.0 * vv), 6.0 * v, 2.0 * u)
    return by_xu, by_xv, by_yv


@triton.jit
def _store_motion(view, program, touched, mean, point, outer, tangents, lens):
    """Rotation and translation, from d loss / d P (point) and d loss / d A (outer [2, 3])."""
    _, _, uc, vc, inverse = tangents
    e00, e01, e10, e11 = lens
    j00, j01, j02 = inverse * e00, inverse * e01, -(inverse * (e00 * uc + e01 * vc))
    j10, j11, j12 = inverse * e10, inverse * e11, -(inverse * (e10 * uc + e11 * vc))
    for column in tl.static_range(3):
        m, ga, gb = mean[column], outer[column], outer[3 + column]
        _store(view, program, column, point[0] * m + j00 * ga + j10 * gb, touched)
        _store(view, program, 3 + column, point[1] * m + j01 * ga + j11 * gb, touched)
        _store(view, program, 6 + column, point[2] * m + j02 * ga + j12 * gb, touched)
        _store(view, program, 9 + column, point[column], touched)


@triton.jit
def _store_lens(view, program, touched, centre, jacobian, tangents, k, FISHEYE: tl.constexpr):
    """The lens, from d loss / d (pixel mean) (centre) and d loss / d J (jacobian [2, 3])."""
    u, v, uc, vc, inverse = tangents
    j00, j01, j02, j10, j11, j12 = jacobian
    fx, fy = k[LENS], k[LENS + 1]
    gx, gy = centre
    x, y, _, _, _ = distort(u, v, k, FISHEYE)
    _, _, xu, xv, yv = distort(uc, vc, k, FISHEYE)
    # J = E [I, -(uc, vc)] / z, and E = [[fx xu, fx xv], [fy xv, fy yv]].
    d00, d01 = inverse * (j00 - uc * j02), inverse * (j01 - vc * j02)
    d10, d11 = inverse * (j10 - uc * j12), inverse * (j11 - vc * j12)
    _store(view, program, 12, gx * x + d00 * xu + d01 * xv, touched)
    _store(view, program, 13, gy * y + d10 * xv + d11 * yv, touched)
    _store(view, program, 14, gx, touched)
    _store(view, program, 15, gy, touched)
    by_x, by_y = _tangent_slopes(u, v, FISHEYE)
    by_xu, by_xv, by_yv = _lens_slopes(uc, vc, FISHEYE)
    gx, gy = fx * gx, fy * gy
    gxu, gxv, gyv = fx * d00, fx * d01 + fy * d10, fy * d11
    for a in tl.static_range(4):
        place = gx * by_x[a] + gy * by_y[a]
        _store(view, program, 16 + a, place + gxu * by_xu[a] + gxv * by_xv[a] + gyv * by_yv[a], touched)


@triton.jit
def store_view(
    view, program, touched, mean, centre, point, outer, jacobian, tangents, lens, k, FISHEYE: tl.constexpr
):
    """Sum a program's touched Gaussians into its row of view float64 [programs, VIEW].

    centre (2), point (3), outer (6), jacobian (6): d loss / d pixel mean, camera point, A, J; tangents
    and lens from `screen_axes`.
    """
    _store_motion(view, program, touched, mean, point, outer, tangents, lens)
    _store_lens(view, program, touched, centre, jacobian, tangents, k, FISHEYE)
