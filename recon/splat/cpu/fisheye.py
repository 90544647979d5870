# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The radial function of a fisheye in the squared tangent s = (x/z)^2 + (y/z)^2, on lanes.

theta_d / r = h P(theta^2): h = atan(r) / r and P(q) = 1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4. All is written in
s, so that nothing is singular on the axis.
"""

from imaging.compute.jit import inlined
from recon.splat.cpu.lanes import above, choose, root
from recon.splat.parameters import LENS

NEAR_AXIS = 0.01
"""Squared tangent below which derivatives of h come from its series: there their quotients lose digits."""


@inlined
def _series(s):
    """atan(r) / r to the last bits, for s below NEAR_AXIS."""
    tail = -1.0 / 11 + s * (1.0 / 13 - s * (1.0 / 15))
    return 1.0 + s * (-1.0 / 3 + s * (1.0 / 5 + s * (-1.0 / 7 + s * (1.0 / 9 + s * tail))))


@inlined
def angle_ratio(s):
    """h = atan(r) / r and its first two derivatives by s, twice the first and four times the second."""
    # tan(a / 2) = tan(a) / (1 + sqrt(1 + tan(a)^2)): four halvings bring any tangent below a tenth.
    f = 1.0 / (1.0 + root(1.0 + s))
    product, t = f, s * f * f
    for _ in range(3):
        f = 1.0 / (1.0 + root(1.0 + t))
        product, t = product * f, t * f * f
    h = 16.0 * product * _series(t)
    along = 1.0 / (1.0 + s)  # d theta / dr
    near = above(NEAR_AXIS, s)
    tail = -10.0 / 11 + s * (12.0 / 13 - s * (14.0 / 15))
    first = -2.0 / 3 + s * (4.0 / 5 + s * (-6.0 / 7 + s * (8.0 / 9 + s * tail)))
    w = choose(near, first, (along - h) / s)
    tail = -40.0 / 11 + s * (60.0 / 13 - s * (84.0 / 15))
    second = 4.0 / 5 + s * (-12.0 / 7 + s * (24.0 / 9 + s * tail))
    bend = choose(near, second, (-1.0 * along * along - 1.5 * w) / s)
    return h, along, w, 2.0 * bend


@inlined
def radial(s, k):
    """theta_d / r, and twice and four times its first and second derivatives by s."""
    k1, k2, k3, k4 = k[LENS + 4], k[LENS + 5], k[LENS + 6], k[LENS + 7]
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


@inlined
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
