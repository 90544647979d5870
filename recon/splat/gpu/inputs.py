# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Inputs of the projection: Gaussians in float64, and the vector of `recon.splat.parameters`.

Brown's lens and the fisheye have kernels each: FISHEYE, None or True, is known when they are compiled.
"""

import triton
import triton.language as tl

from recon.splat import parameters

LENS = tl.constexpr(parameters.LENS)
BOUNDS = tl.constexpr(parameters.BOUNDS)
LIMITS = tl.constexpr(parameters.LIMITS)
_COUNT = tl.constexpr(parameters.COUNT)


@triton.jit
def read_gaussian(means, quats, scales, i, here):
    """Mean, quaternion and scale of Gaussians i in float64; harmless ones where not `here`."""
    x = tl.load(means + 3 * i, mask=here, other=0.0).to(tl.float64)
    y = tl.load(means + 3 * i + 1, mask=here, other=0.0).to(tl.float64)
    z = tl.load(means + 3 * i + 2, mask=here, other=0.0).to(tl.float64)
    qw = tl.load(quats + 4 * i, mask=here, other=1.0).to(tl.float64)
    qx = tl.load(quats + 4 * i + 1, mask=here, other=0.0).to(tl.float64)
    qy = tl.load(quats + 4 * i + 2, mask=here, other=0.0).to(tl.float64)
    qz = tl.load(quats + 4 * i + 3, mask=here, other=0.0).to(tl.float64)
    sx = tl.load(scales + 3 * i, mask=here, other=1.0).to(tl.float64)
    sy = tl.load(scales + 3 * i + 1, mask=here, other=1.0).to(tl.float64)
    sz = tl.load(scales + 3 * i + 2, mask=here, other=1.0).to(tl.float64)
    return (x, y, z), (qw, qx, qy, qz), (sx, sy, sz)


@triton.jit
def appended(values, value):
    """The tuple with one value more."""
    return values + (value,)  # noqa: RUF005  Triton does not know the star


@triton.jit
def read_parameters(pointer):
    """All numbers of the vector of `recon.splat.parameters`."""
    values = ()
    for a in tl.static_range(_COUNT):
        values = appended(values, tl.load(pointer + a))
    return values
