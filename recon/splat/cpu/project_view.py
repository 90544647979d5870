# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project` by the camera: rotation and translation of cam_from_world, and the lens.

A Gaussian reaches the image through its pixel mean f(lens, P), P = W mean + t, and through the axes
A = J(lens, P) W of its ellipse. Computed beside the gradients of the Gaussians, from their parts.
"""

from imaging.compute.jit import inlined
from recon.splat.cpu.fisheye import radial_by_terms
from recon.splat.cpu.lanes import above, choose, load, minus, store, total
from recon.splat.cpu.project import distort
from recon.splat.moved import VIEW
from recon.splat.parameters import LENS


@inlined
def clear_view(sums):
    """Begin: sums float64 [VIEW * 8], eight lanes of each number of a view."""
    for a in range(VIEW * 8):
        sums[a] = 0.0


@inlined
def _add(sums, number, share, counted):
    store(sums, 8 * number, load(sums, 8 * number) + choose(above(counted, 0.0), share, 0.0))


@inlined
def _tangent_slopes(u, v, fisheye):
    """Derivatives of the distorted tangents by the four terms of distortion: of x, then of y."""
    uu, vv, uv = u * u, v * v, u * v
    r2 = uu + vv
    if fisheye is not None:
        (a, b, c, d), _ = radial_by_terms(r2)
        return (u * a, u * b, u * c, u * d), (v * a, v * b, v * c, v * d)
    return (
        (u * r2, u * r2 * r2, 2.0 * uv, r2 + 2.0 * uu),
        (v * r2, v * r2 * r2, r2 + 2.0 * vv, 2.0 * uv),
    )


@inlined
def _lens_slopes(u, v, fisheye):
    """Derivatives of dx/du, dx/dv = dy/du and dy/dv by the four terms of distortion."""
    uu, vv, uv = u * u, v * v, u * v
    r2 = uu + vv
    if fisheye is not None:
        (a, b, c, d), (e, f, g, h) = radial_by_terms(r2)
        return (
            (a + e * uu, b + f * uu, c + g * uu, d + h * uu),
            (e * uv, f * uv, g * uv, h * uv),
            (a + e * vv, b + f * vv, c + g * vv, d + h * vv),
        )
    return (
        (r2 + 2.0 * uu, r2 * (r2 + 4.0 * uu), 2.0 * v, 6.0 * u),
        (2.0 * uv, 4.0 * r2 * uv, 2.0 * u, 2.0 * v),
        (r2 + 2.0 * vv, r2 * (r2 + 4.0 * vv), 6.0 * v, 2.0 * u),
    )


@inlined
def _add_motion(sums, counted, mean, point, outer, tangents, lens):
    """Rotation and translation, from d loss / d P (point) and d loss / d A (outer [2, 3])."""
    _, _, uc, vc, inverse = tangents
    e00, e01, e10, e11 = lens
    a, b = (outer[0], outer[1], outer[2]), (outer[3], outer[4], outer[5])
    j00, j01, j02 = inverse * e00, inverse * e01, minus(inverse * (e00 * uc + e01 * vc))
    j10, j11, j12 = inverse * e10, inverse * e11, minus(inverse * (e10 * uc + e11 * vc))
    for column in range(3):
        m, ga, gb = mean[column], a[column], b[column]
        _add(sums, column, point[0] * m + j00 * ga + j10 * gb, counted)
        _add(sums, 3 + column, point[1] * m + j01 * ga + j11 * gb, counted)
        _add(sums, 6 + column, point[2] * m + j02 * ga + j12 * gb, counted)
        _add(sums, 9 + column, point[column], counted)


@inlined
def _add_lens(sums, counted, centre, jacobian, tangents, k, fisheye):
    """The lens, from d loss / d (pixel mean) (centre) and d loss / d J (jacobian [2, 3])."""
    u, v, uc, vc, inverse = tangents
    j00, j01, j02, j10, j11, j12 = jacobian
    fx, fy = k[LENS], k[LENS + 1]
    gx, gy = centre
    x, y, _, _, _ = distort(u, v, k, fisheye)
    _, _, xu, xv, yv = distort(uc, vc, k, fisheye)
    # J = E [I, -(uc, vc)] / z, and E = [[fx xu, fx xv], [fy xv, fy yv]].
    d00, d01 = inverse * (j00 - uc * j02), inverse * (j01 - vc * j02)
    d10, d11 = inverse * (j10 - uc * j12), inverse * (j11 - vc * j12)
    _add(sums, 12, gx * x + d00 * xu + d01 * xv, counted)
    _add(sums, 13, gy * y + d10 * xv + d11 * yv, counted)
    _add(sums, 14, gx, counted)
    _add(sums, 15, gy, counted)
    by_x, by_y = _tangent_slopes(u, v, fisheye)
    by_xu, by_xv, by_yv = _lens_slopes(uc, vc, fisheye)
    gx, gy = fx * gx, fy * gy
    gxu, gxv, gyv = fx * d00, fx * d01 + fy * d10, fy * d11
    for a in range(4):
        moved = gx * by_x[a] + gy * by_y[a]
        _add(sums, 16 + a, moved + gxu * by_xu[a] + gxv * by_xv[a] + gyv * by_yv[a], counted)


@inlined
def add_view(sums, values, counted, centre, point, outer, jacobian, tangents, lens, k, fisheye):
    """Add eight Gaussians to the sums, those with counted float64 [8] above 0.

    centre (2), point (3), outer (6), jacobian (6): d loss / d pixel mean, camera point, A, J; tangents
    and lens from `screen_axes`.
    """
    weight = load(counted, 0)
    mean = (load(values, 0), load(values, 8), load(values, 16))
    _add_motion(sums, weight, mean, point, outer, tangents, lens)
    _add_lens(sums, weight, centre, jacobian, tangents, k, fisheye)


@inlined
def finish_view(sums, view, task):
    """Add the lanes up into row `task` of view float64 [tasks, VIEW], in a fixed order."""
    for a in range(VIEW):
        view[task, a] = total(load(sums, 8 * a))
