# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Projection of a Gaussian in the world to an ellipse in the image, and the gradient back: EWA splatting.

A = J W [2, 3] says how a small world offset moves the projection; M = A R S [2, 3] is a root of the projected
covariance. Matrices are tuples, row-major.
"""

from typing import NamedTuple

from recon.splat import parameters
from recon.splat.formulas import Language, Operation
from recon.splat.formulas.lens import LensFormulas


class EllipseFormulas(NamedTuple):
    """See `ellipse_formulas`."""

    to_camera: Operation
    rotation: Operation
    screen_axes: Operation
    root_covariance: Operation
    covariance: Operation
    ellipse_gradient: Operation
    shape_gradient: Operation
    axes_gradient: Operation
    jacobian_gradient: Operation
    point_gradient: Operation
    motion_gradient: Operation
    lens_gradient: Operation


def ellipse_formulas(language: Language, lens_formulas: LensFormulas) -> EllipseFormulas:
    """Make the functions of a language; `fisheye` of their arguments is None for Brown's lens."""
    function = language.function
    root, minus, choose = language.root, language.minus, language.choose
    minimum, maximum, at_least, both = language.minimum, language.maximum, language.at_least, language.both
    distort, curvature = lens_formulas.distort, lens_formulas.curvature
    tangent_slopes, derivative_slopes = lens_formulas.tangent_slopes, lens_formulas.derivative_slopes
    lens, bounds = language.index(parameters.LENS), language.index(parameters.BOUNDS)

    @function
    def to_camera(mean, k):
        """World to camera coordinates."""
        x, y, z = mean
        return (
            k[0] * x + k[1] * y + k[2] * z + k[9],
            k[3] * x + k[4] * y + k[5] * z + k[10],
            k[6] * x + k[7] * y + k[8] * z + k[11],
        )

    @function
    def rotation(quat):
        """Rotation matrix of a quaternion of any length."""
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

    @function
    def projection_jacobian(uc, vc, inverse, derivative):
        """J [2, 3] = E [I, -(uc, vc)] / z, E the derivative of the lens at the clamped tangents, px."""
        e00, e01, e10, e11 = derivative
        return (
            inverse * e00,
            inverse * e01,
            minus(inverse * (e00 * uc + e01 * vc)),
            inverse * e10,
            inverse * e11,
            minus(inverse * (e10 * uc + e11 * vc)),
        )

    @function
    def screen_axes(point, k, fisheye):
        """A = J W [2, 3], at a camera point, px per unit.

        Also the tangents u, v, the clamped ones, 1 / z, and the derivative E of the lens at the clamped ones.
        """
        x, y, z = point
        inverse = 1.0 / z
        u, v = x * inverse, y * inverse
        uc = minimum(maximum(u, k[bounds]), k[bounds + 1])
        vc = minimum(maximum(v, k[bounds + 2]), k[bounds + 3])
        _, _, xu, xv, yv = distort(uc, vc, k, fisheye)
        fx, fy = k[lens], k[lens + 1]
        derivative = (fx * xu, fx * xv, fy * xv, fy * yv)
        j00, j01, j02, j10, j11, j12 = projection_jacobian(uc, vc, inverse, derivative)
        axes = (
            j00 * k[0] + j01 * k[3] + j02 * k[6],
            j00 * k[1] + j01 * k[4] + j02 * k[7],
            j00 * k[2] + j01 * k[5] + j02 * k[8],
            j10 * k[0] + j11 * k[3] + j12 * k[6],
            j10 * k[1] + j11 * k[4] + j12 * k[7],
            j10 * k[2] + j11 * k[5] + j12 * k[8],
        )
        return axes, (u, v, uc, vc, inverse), derivative

    @function
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

    @function
    def covariance(m, blur):
        """Entries a, b, c of M M^T + blur I and its determinant, without cancellation (Cauchy-Binet)."""
        m0, m1, m2, n0, n1, n2 = m
        a = m0 * m0 + m1 * m1 + m2 * m2
        b = m0 * n0 + m1 * n1 + m2 * n2
        c = n0 * n0 + n1 * n1 + n2 * n2
        p, q, s = m0 * n1 - m1 * n0, m0 * n2 - m2 * n0, m1 * n2 - m2 * n1
        determinant = p * p + q * q + s * s + blur * (a + c) + blur * blur
        return a + blur, b, c + blur, determinant

    @function
    def whitened_root(m, blur, determinant):
        """C^-1 M [2, 3], C = M M^T + blur, from the minors of M: entries of C^-1 cancel in a needle."""
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

    @function
    def ellipse_gradient(moments, m, blur):
        """d loss / d mean2d (2) and the rows of d loss / d M (3 each).

        moments: sums over pixels of s, s dx, s dy, s dx dx, s dx dy, s dy dy: s = alpha d loss / d alpha,
        (dx, dy) from the mean to the pixel.
        """
        a, b, c, determinant = covariance(m, blur)
        ia, ib, ic = c / determinant, minus(b) / determinant, a / determinant
        # q = d^T C^-1 d: dq/dmean = -2 C^-1 d, dq/dC = -(C^-1 d)(C^-1 d)^T; alpha falls as exp(-q / 2), and
        # d loss / d M = 2 (d loss / d C) M.
        _, mx, my, mxx, mxy, myy = moments
        r0, r1, r2, s0, s1, s2 = whitened_root(m, blur, determinant)
        x0, x1, x2 = mxx * r0 + mxy * s0, mxx * r1 + mxy * s1, mxx * r2 + mxy * s2
        y0, y1, y2 = mxy * r0 + myy * s0, mxy * r1 + myy * s1, mxy * r2 + myy * s2
        return (
            (ia * mx + ib * my, ib * mx + ic * my),
            (ia * x0 + ib * y0, ia * x1 + ib * y1, ia * x2 + ib * y2),
            (ib * x0 + ic * y0, ib * x1 + ic * y1, ib * x2 + ic * y2),
        )

    @function
    def quat_gradient(g, quat):
        """d loss / d quaternion from d loss / d rotation matrix, through the normalisation."""
        w, x, y, z = quat
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

    @function
    def shape_gradient(p, q, axes, r, scale, quat):
        """d loss / d scale (3), d loss / d quaternion (4) from the rows p, q of d loss / d M, M = A R S."""
        a0, a1, a2, b0, b1, b2 = axes
        sx, sy, sz = scale
        # d loss / d (R S) = A^T dM, column by column; its columns dotted with R's give the scales.
        f0, f1, f2 = a0 * p[0] + b0 * q[0], a0 * p[1] + b0 * q[1], a0 * p[2] + b0 * q[2]
        f3, f4, f5 = a1 * p[0] + b1 * q[0], a1 * p[1] + b1 * q[1], a1 * p[2] + b1 * q[2]
        f6, f7, f8 = a2 * p[0] + b2 * q[0], a2 * p[1] + b2 * q[1], a2 * p[2] + b2 * q[2]
        grown = (
            f0 * r[0] + f3 * r[3] + f6 * r[6],
            f1 * r[1] + f4 * r[4] + f7 * r[7],
            f2 * r[2] + f5 * r[5] + f8 * r[8],
        )
        rotated = (f0 * sx, f1 * sy, f2 * sz, f3 * sx, f4 * sy, f5 * sz, f6 * sx, f7 * sy, f8 * sz)
        return grown, quat_gradient(rotated, quat)

    @function
    def axes_gradient(p, q, r):
        """d loss / d A [2, 3] from d loss / d M, rows p and q already times the scales: dM (R S)^T."""
        return (
            p[0] * r[0] + p[1] * r[1] + p[2] * r[2],
            p[0] * r[3] + p[1] * r[4] + p[2] * r[5],
            p[0] * r[6] + p[1] * r[7] + p[2] * r[8],
            q[0] * r[0] + q[1] * r[1] + q[2] * r[2],
            q[0] * r[3] + q[1] * r[4] + q[2] * r[5],
            q[0] * r[6] + q[1] * r[7] + q[2] * r[8],
        )

    @function
    def jacobian_gradient(outer, k):
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

    @function
    def point_gradient(jacobian, centre, tangents, derivative, k, fisheye):
        """d loss / d camera point from d loss / d J and d loss / d mean2d; J = E [I, -(uc, vc)] / z."""
        j00, j01, j02, j10, j11, j12 = jacobian
        u, v, uc, vc, inverse = tangents
        e00, e01, e10, e11 = derivative
        fx, fy = k[lens], k[lens + 1]
        d00, d01, d10, d11 = j00 - uc * j02, j01 - vc * j02, j10 - uc * j12, j11 - vc * j12
        # J is proportional to 1 / z.
        g_inverse = e00 * d00 + e01 * d01 + e10 * d10 + e11 * d11
        xuu, xuv, xvv, yvv = curvature(uc, vc, k, fisheye)
        guc = fx * (d00 * xuu + d01 * xuv) + fy * (d10 * xuv + d11 * xvv) - (j02 * e00 + j12 * e10)
        gvc = fx * (d00 * xuv + d01 * xvv) + fy * (d10 * xvv + d11 * yvv) - (j02 * e01 + j12 * e11)
        _, _, xu, xv, yv = distort(u, v, k, fisheye)
        gx, gy = centre
        free_u = both(at_least(u, k[bounds]), at_least(k[bounds + 1], u))
        free_v = both(at_least(v, k[bounds + 2]), at_least(k[bounds + 3], v))
        gu = (fx * xu) * gx + (fy * xv) * gy + choose(free_u, inverse * guc, 0.0)
        gv = (fx * xv) * gx + (fy * yv) * gy + choose(free_v, inverse * gvc, 0.0)
        depth = minus(inverse * (u * gu + v * gv + inverse * g_inverse))
        return inverse * gu, inverse * gv, depth

    @function
    def motion_gradient(mean, point, outer, tangents, derivative):
        """Rotation [3, 3] and translation (3), from d loss / d P (point) and d loss / d A (outer [2, 3]).

        P = W mean + t, and A = J W.
        """
        _, _, uc, vc, inverse = tangents
        j00, j01, j02, j10, j11, j12 = projection_jacobian(uc, vc, inverse, derivative)
        x, y, z = mean
        px, py, pz = point
        a0, a1, a2, b0, b1, b2 = outer
        return (
            px * x + j00 * a0 + j10 * b0,
            px * y + j00 * a1 + j10 * b1,
            px * z + j00 * a2 + j10 * b2,
            py * x + j01 * a0 + j11 * b0,
            py * y + j01 * a1 + j11 * b1,
            py * z + j01 * a2 + j11 * b2,
            pz * x + j02 * a0 + j12 * b0,
            pz * y + j02 * a1 + j12 * b1,
            pz * z + j02 * a2 + j12 * b2,
            px,
            py,
            pz,
        )

    @function
    def lens_gradient(centre, jacobian, tangents, k, fisheye):
        """The eight numbers of the lens, from d loss / d (pixel mean) (centre) and d loss / d J [2, 3]."""
        u, v, uc, vc, inverse = tangents
        j00, j01, j02, j10, j11, j12 = jacobian
        fx, fy = k[lens], k[lens + 1]
        gx, gy = centre
        x, y, _, _, _ = distort(u, v, k, fisheye)
        _, _, xu, xv, yv = distort(uc, vc, k, fisheye)
        # J = E [I, -(uc, vc)] / z, and E = [[fx xu, fx xv], [fy xv, fy yv]].
        d00, d01 = inverse * (j00 - uc * j02), inverse * (j01 - vc * j02)
        d10, d11 = inverse * (j10 - uc * j12), inverse * (j11 - vc * j12)
        by_x, by_y = tangent_slopes(u, v, fisheye)
        by_xu, by_xv, by_yv = derivative_slopes(uc, vc, fisheye)
        px, py = fx * gx, fy * gy
        gxu, gxv, gyv = fx * d00, fx * d01 + fy * d10, fy * d11
        return (
            gx * x + d00 * xu + d01 * xv,
            gy * y + d10 * xv + d11 * yv,
            gx,
            gy,
            px * by_x[0] + py * by_y[0] + gxu * by_xu[0] + gxv * by_xv[0] + gyv * by_yv[0],
            px * by_x[1] + py * by_y[1] + gxu * by_xu[1] + gxv * by_xv[1] + gyv * by_yv[1],
            px * by_x[2] + py * by_y[2] + gxu * by_xu[2] + gxv * by_xv[2] + gyv * by_yv[2],
            px * by_x[3] + py * by_y[3] + gxu * by_xu[3] + gxv * by_xv[3] + gyv * by_yv[3],
        )

    return EllipseFormulas(
        to_camera=to_camera,
        rotation=rotation,
        screen_axes=screen_axes,
        root_covariance=root_covariance,
        covariance=covariance,
        ellipse_gradient=ellipse_gradient,
        shape_gradient=shape_gradient,
        axes_gradient=axes_gradient,
        jacobian_gradient=jacobian_gradient,
        point_gradient=point_gradient,
        motion_gradient=motion_gradient,
        lens_gradient=lens_gradient,
    )
