# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project` by the camera: rotation and translation of cam_from_world, and the lens.

A Gaussian reaches the image through its pixel mean f(lens,
P), P = W mean + t, and through the axes A = J(lens, P) W of its ellipse.
"""

import triton
import triton.language as tl

from recon.splat.corrected_camera import VIEW as _VIEW
from recon.splat.gpu.formulas import lens_gradient, motion_gradient
from recon.splat.gpu.inputs import LENS

VIEW = tl.constexpr(_VIEW)


@triton.jit
def _store(view, program, number: tl.constexpr, share, touched):
    tl.store(view + program * VIEW + number, tl.sum(tl.where(touched, share, 0.0), axis=0))


@triton.jit
def store_view(
    view, program, touched, mean, centre, point, outer, jacobian, tangents, lens, k, FISHEYE: tl.constexpr
):
    """Sum a program's touched Gaussians into its row of view float64 [programs, VIEW].

    centre (2), point (3), outer (6), jacobian (6): d loss / d pixel mean, camera point, A, J; tangents
    and lens from `screen_axes`.
    """
    motion = motion_gradient(mean, point, outer, tangents, lens)
    for a in tl.static_range(12):
        _store(view, program, a, motion[a], touched)
    numbers = lens_gradient(centre, jacobian, tangents, k, FISHEYE)
    for a in tl.static_range(8):
        _store(view, program, LENS + a, numbers[a], touched)
