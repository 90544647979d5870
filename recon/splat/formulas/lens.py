# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""Lenses: distorted tangents, and their derivatives by the tangents and by the terms of distortion.

Brown's, and a fisheye in the squared tangent s = (x/z)^2 + (y/z)^2: theta_d / r = h P(theta^2) with
h = atan(r) / r and P(q) = 1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4. All is written in s, so that nothing is
singular on the axis.
"""

from typing import NamedTuple

from recon.splat import parameters
from recon.splat.formulas import Language, Operation

NEAR_AXIS = 0.01
"""Squared tangent below which derivatives of h come from its series: there their quotients lose digits."""


class LensFormulas(NamedTuple):
    """Functions of `lens_formulas`; `fisheye` of their arguments is None for Brown's lens."""

    radial: Operation
    radial_by_terms: Operation
    distort: Operation
    curvature: Operation
    tangent_slopes: Operation
    derivative_slopes: Operation


def lens_formulas(language: Language) -> LensFormulas:
    """The functions of a language."""
    function = language.function
    root, above, choose = language.root, language.above, language.choose
    lens, near_axis = language.index(parameters.LENS), language.number(NEAR_AXIS)

    @function
    def series(s):
        """atan(r) / r to the last bits, for s below NEAR_AXIS."""
        tail = -1.0 / 11 + s * (1.0 / 13 - s * (1.0 / 15))
        return 1.0 + s * (-1.0 / 3 + s * (1.0 / 5 + s * (-1.0 / 7 + s * (1.0 / 9 + s * tail))))

    @function
    def angle_ratio(s):
        """h = atan(r) / r and its first two derivatives by s, twice the first and four times the second."""
        # tan(a / 2) = tan(a) / (1 + sqrt(1 + tan(a)^2)): four halvings bring any tangent below a tenth.
        f = 1.0 / (1.0 + root(1.0 + s))
        product, t = f, s * f * f
        f = 1.0 / (1.0 + root(1.0 + t))
        product, t = product * f, t * f * f
        f = 1.0 / (1.0 + root(1.0 + t))
        product, t = product * f, t * f * f
        f = 1.0 / (1.0 + root(1.0 + t))
        product, t = product * f, t * f * f
        h = 16.0 * product * series(t)
        along = 1.0 / (1.0 + s)  # d theta / dr
        near = above(near_axis, s)
        safe = choose(near, 1.0, s)
        tail = -10.0 / 11 + s * (12.0 / 13 - s * (14.0 / 15))
        first = -2.0 / 3 + s * (4.0 / 5 + s * (-6.0 / 7 + s * (8.0 / 9 + s * tail)))
        w = choose(near, first, (along - h) / safe)
        tail = -40.0 / 11 + s * (60.0 / 13 - s * (84.0 / 15))
        second = 4.0 / 5 + s * (-12.0 / 7 + s * (24.0 / 9 + s * tail))
        bend = choose(near, second, (-1.0 * along * along - 1.5 * w) / safe)
        return h, along, w, 2.0 * bend

    @function
    def radial(s, k):
        """theta_d / r, and twice and four times its first and second derivatives by s."""
        k1, k2, k3, k4 = k[lens + 4], k[lens + 5], k[lens + 6], k[lens + 7]
        h, along, w, bend = angle_ratio(s)
        q, turn = h * h * s, 2.0 * h * along  # theta^2, and twice its derivative by s
        p = 1.0 + q * (k1 + q * (k2 + q * (k3 + q * k4)))
        dp = k1 + q * (2.0 * k2 + q * (3.0 * k3 + q * (4.0 * k4)))
        ddp = 2.0 * k2 + q * (6.0 * k3 + q * (12.0 * k4))
        slope = w * p + h * turn * dp
        # Twice the derivative of `turn` by s: that of along is -along^2.
        turning = 2.0 * along * (w - 2.0 * h * along)
        curve = bend * p + 2.0 * w * turn * dp + h * turning * dp + h * turn * turn * ddp
        return h * p, slope, curve

    @function
    def radial_by_terms(s):
        """Derivatives by k1 to k4 of theta_d / r, and of twice its derivative by s."""
        h, along, w, _ = angle_ratio(s)
        q, turn = h * h * s, 2.0 * h * along
        q2 = q * q
        return (
            (h * q, h * q2, h * q2 * q, h * q2 * q2),
            (
                w * q + h * turn,
                w * q2 + h * turn * (2.0 * q),
                w * q2 * q + h * turn * (3.0 * q2),
                w * q2 * q2 + h * turn * (4.0 * q2 * q),
            ),
        )

    @function
    def distort(u, v, k, fisheye):
        """Distorted tangents and their derivatives: x, y, dx/du, dx/dv = dy/du, dy/dv."""
        uu, vv, uv = u * u, v * v, u * v
        r2 = uu + vv
        if fisheye is not None:
            ratio, slope, _ = radial(r2, k)
            x, y = u * ratio, v * ratio
            xu, xv, yv = ratio + slope * uu, slope * uv, ratio + slope * vv
        else:
            k1, k2, p1, p2 = k[lens + 4], k[lens + 5], k[lens + 6], k[lens + 7]
            ratio = 1.0 + r2 * (k1 + r2 * k2)
            slope = 2.0 * k1 + (4.0 * k2) * r2
            x = u * ratio + (2.0 * p1) * uv + p2 * (r2 + 2.0 * uu)
            y = v * ratio + p1 * (r2 + 2.0 * vv) + (2.0 * p2) * uv
            xu = ratio + slope * uu + (2.0 * p1) * v + (6.0 * p2) * u
            yv = ratio + slope * vv + (6.0 * p1) * v + (2.0 * p2) * u
            xv = slope * uv + (2.0 * p1) * u + (2.0 * p2) * v
        return x, y, xu, xv, yv

    @function
    def curvature(u, v, k, fisheye):
        """Second derivatives of the distorted tangents: xuu, xuv, xvv = yuv, yvv (yuu = xuv)."""
        if fisheye is not None:
            _, slope, curve = radial(u * u + v * v, k)
            xuu, xuv = u * (3.0 * slope + curve * u * u), v * (slope + curve * u * u)
            xvv, yvv = u * (slope + curve * v * v), v * (3.0 * slope + curve * v * v)
        else:
            k1, k2, p1, p2 = k[lens + 4], k[lens + 5], k[lens + 6], k[lens + 7]
            slope = 2.0 * k1 + (4.0 * k2) * (u * u + v * v)
            xuu = 3.0 * slope * u + (8.0 * k2) * u * u * u + 6.0 * p2
            xuv = slope * v + (8.0 * k2) * u * u * v + 2.0 * p1
            xvv = slope * u + (8.0 * k2) * u * v * v + 2.0 * p2
            yvv = 3.0 * slope * v + (8.0 * k2) * v * v * v + 6.0 * p1
        return xuu, xuv, xvv, yvv

    @function
    def tangent_slopes(u, v, fisheye):
        """Derivatives of the distorted tangents by the four terms of distortion: of x, then of y."""
        uu, vv, uv = u * u, v * v, u * v
        r2 = uu + vv
        if fisheye is not None:
            by, _ = radial_by_terms(r2)
            by_x = (u * by[0], u * by[1], u * by[2], u * by[3])
            by_y = (v * by[0], v * by[1], v * by[2], v * by[3])
        else:
            by_x = (u * r2, u * r2 * r2, 2.0 * uv, r2 + 2.0 * uu)
            by_y = (v * r2, v * r2 * r2, r2 + 2.0 * vv, 2.0 * uv)
        return by_x, by_y

    @function
    def derivative_slopes(u, v, fisheye):
        """Derivatives of dx/du, dx/dv = dy/du and dy/dv by the four terms of distortion."""
        uu, vv, uv = u * u, v * v, u * v
        r2 = uu + vv
        if fisheye is not None:
            by, turn = radial_by_terms(r2)
            by_xu = (by[0] + turn[0] * uu, by[1] + turn[1] * uu, by[2] + turn[2] * uu, by[3] + turn[3] * uu)
            by_xv = (turn[0] * uv, turn[1] * uv, turn[2] * uv, turn[3] * uv)
            by_yv = (by[0] + turn[0] * vv, by[1] + turn[1] * vv, by[2] + turn[2] * vv, by[3] + turn[3] * vv)
        else:
            by_xu = (r2 + 2.0 * uu, r2 * (r2 + 4.0 * uu), 2.0 * v, 6.0 * u)
            by_xv = (2.0 * uv, 4.0 * r2 * uv, 2.0 * u, 2.0 * v)
            by_yv = (r2 + 2.0 * vv, r2 * (r2 + 4.0 * vv), 6.0 * v, 2.0 * u)
        return by_xu, by_xv, by_yv

    return LensFormulas(radial, radial_by_terms, distort, curvature, tangent_slopes, derivative_slopes)
