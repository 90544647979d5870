# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project` by the camera: rotation and translation of cam_from_world, and the lens.

A Gaussian reaches the image through its pixel mean f(lens, P), P = W mean + t, and through the axes
A = J(lens, P) W of its ellipse. Computed beside the gradients of the Gaussians, from their parts.
"""

from imaging.compute.jit import inlined
from recon.splat.corrected_camera import VIEW
from recon.splat.cpu.formulas import lens_gradient, motion_gradient
from recon.splat.cpu.lanes import above, choose, load, store, total
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
def add_view(sums, values, counted, centre, point, outer, jacobian, tangents, lens, k, fisheye):
    """Add eight Gaussians to the sums, those with counted float64 [8] above 0.

    centre (2), point (3), outer (6), jacobian (6): d loss / d pixel mean, camera point, A, J; tangents
    and lens from `screen_axes`.
    """
    weight = load(counted, 0)
    mean = (load(values, 0), load(values, 8), load(values, 16))
    motion = motion_gradient(mean, point, outer, tangents, lens)
    for a in range(12):
        _add(sums, a, motion[a], weight)
    numbers = lens_gradient(centre, jacobian, tangents, k, fisheye)
    for a in range(8):
        _add(sums, LENS + a, numbers[a], weight)


@inlined
def finish_view(sums, view, task):
    """Add the lanes up into row `task` of view float64 [tasks, VIEW], in a fixed order."""
    for a in range(VIEW):
        view[task, a] = total(load(sums, 8 * a))
