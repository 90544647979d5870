# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
"""The gradient of `project`: from sums over pixels to means, rotations, scales and opacities.

As there, in float64 and eight Gaussians at a time.
"""

import numpy as np

from imaging.compute.jit import inlined, kernel
from imaging.compute.threads import take_number
from recon.splat.corrected_camera import VIEW
from recon.splat.cpu.composite_backward import MOMENTS, slot_size
from recon.splat.cpu.formulas import (
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
from recon.splat.cpu.lanes import above, choose, load, minimum, store
from recon.splat.cpu.project import INPUTS, read_eight
from recon.splat.cpu.project_view import add_view, clear_view, finish_view
from recon.splat.cpu.tiles import TASK, TILE
from recon.splat.parameters import LIMITS

_OUTPUTS = 11
"""Gradients of mean 3, quaternion 4, scale 3, opacity."""
_slot_size = inlined(slot_size)


@inlined
def _add_slots(slots, first, last, tile, entry, across, px, py, moments, j, light, colour):
    """Add up a Gaussian's slots in their order: lane j of moments, colour [C].

    moments: of s, s dx, s dy, s dx dx, s dx dy, s dy dy, (dx, dy) from the mean to the pixel. light: float64
    [C], scratch. Returns the pull both ways and the largest weight.
    """
    s = sx = sy = sxx = sxy = syy = strength = peak = 0.0
    size = _slot_size(len(light))
    for c in range(len(light)):
        light[c] = 0.0
    for slot in range(first, last):
        t = tile[entry + slot - first]
        ox = (t % across) * TILE + 0.5 * TILE - px
        oy = (t // across) * TILE + 0.5 * TILE - py
        at = size * slot
        m, mx, my = np.float64(slots[at]), np.float64(slots[at + 1]), np.float64(slots[at + 2])
        s += m
        sx += mx + ox * m
        sy += my + oy * m
        sxx += slots[at + 3] + 2.0 * ox * mx + ox * ox * m
        sxy += slots[at + 4] + ox * my + oy * mx + ox * oy * m
        syy += slots[at + 5] + 2.0 * oy * my + oy * oy * m
        for c in range(len(light)):
            light[c] += slots[at + MOMENTS + c]
        strength += slots[at + MOMENTS + len(light)]
        peak = max(peak, np.float64(slots[at + MOMENTS + len(light) + 1]))
    moments[j], moments[8 + j], moments[16 + j] = s, sx, sy
    moments[24 + j], moments[32 + j], moments[40 + j] = sxx, sxy, syy
    for c in range(len(light)):
        colour[c] = light[c]
    return np.sqrt(max(strength * strength - s * s, 0.0)), peak


@inlined
def _backward_eight(values, moments, k, fisheye, out, counted, sums, view):
    """Fill out float64 [_OUTPUTS * 8] from the Gaussians and their moments.

    And `add_view` to the sums, unless view is None: then the compiler leaves that out.
    """
    point = to_camera((load(values, 0), load(values, 8), load(values, 16)), k)
    axes, tangents, lens = screen_axes(point, k, fisheye)
    quat = (load(values, 24), load(values, 32), load(values, 40), load(values, 48))
    scale = (load(values, 56), load(values, 64), load(values, 72))
    r = rotation(quat)
    m = root_covariance(axes, r, scale)
    sums_of_pixels = (
        load(moments, 0), load(moments, 8), load(moments, 16),
        load(moments, 24), load(moments, 32), load(moments, 40),
    )  # fmt: skip
    centre, p, q = ellipse_gradient(sums_of_pixels, m, k[LIMITS + 1])
    o = minimum(load(values, 80), k[LIMITS + 2])
    store(out, 80, choose(above(o, 0.0), load(moments, 0) / o, 0.0))

    grown, turned = shape_gradient(p, q, axes, r, scale, quat)
    for a in range(3):
        store(out, 56 + 8 * a, grown[a])
    for a in range(4):
        store(out, 24 + 8 * a, turned[a])

    p = (p[0] * scale[0], p[1] * scale[1], p[2] * scale[2])
    q = (q[0] * scale[0], q[1] * scale[1], q[2] * scale[2])
    outer = axes_gradient(p, q, r)
    jacobian = jacobian_gradient(outer, k)
    x, y, z = point_gradient(jacobian, centre, tangents, lens, k, fisheye)
    if view is not None:
        add_view(sums, values, counted, centre, (x, y, z), outer, jacobian, tangents, lens, k, fisheye)
    store(out, 0, k[0] * x + k[3] * y + k[6] * z)
    store(out, 8, k[1] * x + k[4] * y + k[7] * z)
    store(out, 16, k[2] * x + k[5] * y + k[8] * z)


@kernel
def project_backward(
    counter, means, quats, scales, opacities, k, fisheye, projected, entries, across, slots,
    grad_means, grad_quats, grad_scales, grad_opacities, grad_colours, pull, weight, view,
):  # fmt: skip
    """Gradients [N, ...] of all inputs, zero for Gaussians that were not drawn.

    slots: from `composite_backward`. pull float32 [N]: with s = alpha d loss / d alpha of the pixels,
    sqrt((sum |s|)^2 - (sum s)^2); weight float32 [N]: largest blending weight. view float64 [tasks, VIEW], to
    be summed over the tasks: d loss / d (the first VIEW numbers of k); or None.
    """
    n = len(means)
    drawn, ids = np.empty(TASK, np.int64), np.empty(8, np.int64)
    values, moments, results = np.empty(INPUTS * 8), np.empty(MOMENTS * 8), np.empty(_OUTPUTS * 8)
    counted, sums, light = np.empty(8), np.empty(VIEW * 8), np.empty(grad_colours.shape[1])
    task = take_number(counter)
    while task * TASK < n:
        count = 0
        for i in range(task * TASK, min((task + 1) * TASK, n)):
            drawn[count] = i
            count += entries.number[i] > 0
            for a in range(3):
                grad_means[i, a] = grad_scales[i, a] = 0.0
            for a in range(len(light)):
                grad_colours[i, a] = 0.0
            for a in range(4):
                grad_quats[i, a] = 0.0
            grad_opacities[i] = pull[i] = weight[i] = 0.0
        if view is not None:
            clear_view(sums)
        for first in range(0, count, 8):
            for j in range(8):
                i = drawn[min(first + j, count - 1)]
                ids[j] = i
                pull[i], weight[i] = _add_slots(
                    slots, entries.slot[i], entries.slot[i + 1], entries.tile, entries.start[i], across,
                    projected.shape[i, 0], projected.shape[i, 1], moments, j, light, grad_colours[i],
                )  # fmt: skip
                counted[j] = weight[i] if first + j < count else 0.0
            read_eight(means, quats, scales, opacities, ids, values)
            _backward_eight(values, moments, k, fisheye, results, counted, sums, view)
            for j in range(8):
                i = ids[j]
                if weight[i] > 0.0:
                    for a in range(3):
                        grad_means[i, a] = results[8 * a + j]
                        grad_scales[i, a] = results[56 + 8 * a + j]
                    for a in range(4):
                        grad_quats[i, a] = results[24 + 8 * a + j]
                    grad_opacities[i] = results[80 + j]
        if view is not None:
            finish_view(sums, view, task)
        task = take_number(counter)
