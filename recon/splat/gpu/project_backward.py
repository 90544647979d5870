# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project`: from sums over pixels to means, rotations, scales and opacities.

As there, in float64 and one thread a Gaussian.
"""

import triton
import triton.language as tl

from recon.splat.gpu.formulas import (
    axes_gradient,
    ellipse_gradient,
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


@triton.jit
def _read_moments(pointer, touched):
    """The moments, zero where nothing was touched."""
    moments = ()
    for a in tl.static_range(MOMENTS):
        moments = appended(moments, tl.load(pointer + a, mask=touched, other=0.0))
    return moments


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
    centre, p, q = ellipse_gradient(sums, m, k[LIMITS + 1])
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
