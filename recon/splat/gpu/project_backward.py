# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project`: from sums over pixels to means, rotations, scales and opacities.

As there, in float64 and one thread a Gaussian.
"""

import triton
import triton.language as tl

from recon.splat import parameters
from recon.splat.gpu.formulas import (
    axes_gradient,
    covariance,
    jacobian_gradient,
    point_gradient,
    root_covariance,
    rotation,
    screen_axes,
    shape_gradient,
    to_camera,
)
from recon.splat.gpu.inputs import LIMITS, appended, read_gaussian, read_parameters
from recon.splat.gpu.project_view import store_view
from recon.splat.gpu.slots import MOMENTS

_UNFOLD = tl.constexpr(1.0 / parameters.FOLD)


@triton.jit
def _read_moments(pointer, touched):
    """The moments, zero where nothing was touched."""
    moments = ()
    for a in tl.static_range(MOMENTS):
        moments = appended(moments, tl.load(pointer + a, mask=touched, other=0.0).to(tl.float64))
    return moments


@triton.jit
def _ellipse_gradient(moments, m, blur):
    """d loss / d mean2d (2) and the rows of d loss / d M (3 each); moments: from `add_slots`.

    With W the root of the inverse covariance, y = W d, and N = W M, they are W^T (sum s y) and
    W^T (sum s y y^T) N: alpha falls as exp(-y^2 / 2), where y is not folded. N's second row comes from minors
    of M, since it cancels in a needle.
    """
    m0, m1, m2, n0, n1, n2 = m
    a, b, _, determinant = covariance(m, blur)
    w22 = tl.sqrt(a / determinant)
    w11, slope = 1.0 / tl.sqrt(a), w22 / a
    w21 = -slope * b
    _, y1, y2, e11, e12, e22 = moments
    e11, e12, e22 = e11 * (_UNFOLD * _UNFOLD), e12 * (_UNFOLD * _UNFOLD), e22 * (_UNFOLD * _UNFOLD)
    p, q, s = m0 * n1 - m1 * n0, m0 * n2 - m2 * n0, m1 * n2 - m2 * n1
    t0 = slope * (blur * n0 - p * m1 - q * m2)
    t1 = slope * (blur * n1 + p * m0 - s * m2)
    t2 = slope * (blur * n2 + q * m0 + s * m1)
    m0, m1, m2 = w11 * m0, w11 * m1, w11 * m2
    q0, q1, q2 = e12 * m0 + e22 * t0, e12 * m1 + e22 * t1, e12 * m2 + e22 * t2
    return (
        (_UNFOLD * (w11 * y1 + w21 * y2), _UNFOLD * w22 * y2),
        (
            w11 * (e11 * m0 + e12 * t0) + w21 * q0,
            w11 * (e11 * m1 + e12 * t1) + w21 * q1,
            w11 * (e11 * m2 + e12 * t2) + w21 * q2,
        ),
        (w22 * q0, w22 * q1, w22 * q2),
    )


@triton.jit
def _store(pointer, value, touched, here):
    """A gradient in float32, zero where nothing was touched."""
    tl.store(pointer, tl.where(touched, value, 0.0).to(tl.float32), mask=here)


@triton.jit(do_not_specialize=["n"])
def project_backward(
    means, quats, scales, opacities, parameter, n, moments, weight,
    grad_means, grad_quats, grad_scales, grad_opacities, view,
    BLOCK: tl.constexpr, MOVING: tl.constexpr, FISHEYE: tl.constexpr,
):  # fmt: skip
    """Gradients float32 [N, ...] of all inputs but colours, zero for Gaussians that touched no pixel.

    moments and weight: from `add_slots`. view float64 [programs, VIEW], to be summed over the programs, if
    MOVING: d loss / d (the first VIEW parameters).
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
    axes, tangents, lens = screen_axes((x, y, z), k, FISHEYE)
    r = rotation(quat)
    m = root_covariance(axes, r, scale)
    centre, p, q = _ellipse_gradient(sums, m, k[LIMITS + 1])
    _store(grad_opacities + i, sums[0] / tl.minimum(o, k[LIMITS + 2]), touched, here)

    grown, turned = shape_gradient(p, q, axes, r, scale, quat)
    for a in tl.static_range(3):
        _store(grad_scales + 3 * i + a, grown[a], touched, here)
    for a in tl.static_range(4):
        _store(grad_quats + 4 * i + a, turned[a], touched, here)

    sx, sy, sz = scale
    p, q = (p[0] * sx, p[1] * sy, p[2] * sz), (q[0] * sx, q[1] * sy, q[2] * sz)
    outer = axes_gradient(p, q, r)
    jacobian = jacobian_gradient(outer, k)
    x, y, z = point_gradient(jacobian, centre, tangents, lens, k, FISHEYE)
    _store(grad_means + 3 * i, k[0] * x + k[3] * y + k[6] * z, touched, here)
    _store(grad_means + 3 * i + 1, k[1] * x + k[4] * y + k[7] * z, touched, here)
    _store(grad_means + 3 * i + 2, k[2] * x + k[5] * y + k[8] * z, touched, here)
    if MOVING:
        point = (x, y, z)
        store_view(view, program, touched, mean, centre, point, outer, jacobian, tangents, lens, k, FISHEYE)
