"""Camera and limits as one vector of numbers, read by the projection kernels of every execution."""

import math

import numpy as np

from imaging.arrays import Array
from recon.splat.camera import SplatCamera
from recon.splat.limits import Limits

LENS = 12
"""Index in the parameter vector of fx fy cx cy k1 k2 p1 p2, of a fisheye fx fy cx cy k1 k2 k3 k4; before it
rotation (9) and translation (3)."""
BOUNDS = 20
"""Index of u_min u_max v_min v_max, the clamp of the Jacobian, then the squared monotone radius."""
LIMITS = 25
"""Index of near, blur, alpha_max, alpha_min, tau * luminance_reference (or inf), max_sigma^2, and of the
width and the height of the image."""

FOLD = math.sqrt(0.5 / math.log(2.0))
"""Whitened coordinates times this: exp(-(x^2 + y^2) / 2) = 2^-((FOLD x)^2 + (FOLD y)^2)."""
COUNT = 33
"""Numbers in the vector."""


def parameters(camera: SplatCamera, limits: Limits) -> Array:
    """All that the projection needs to know of camera and limits, as float64 [33]."""
    motion = np.asarray(camera.cam_from_world, np.float64)
    reference = limits.luminance_reference
    return np.array(
        [
            *motion[:3, :3].ravel(),
            *motion[:3, 3],
            *camera.lens,
            *camera.tangent_bounds(limits.tangent_margin),
            camera.monotone_radius2,
            *(limits.near, limits.blur, limits.alpha_max, limits.alpha_min),
            math.inf if reference is None else limits.tau * reference,
            limits.max_sigma**2,
            *(camera.width, camera.height),
        ]
    )
