"""The oracle: every Gaussian against every pixel, in float64, in plain torch with autograd.

Slow and simple on purpose: no tiles, no culling by extent, no hand-written gradient. What the fast
rasterisers must agree with, cut-offs included.
"""

from functools import partial

import torch
from torch.utils.checkpoint import checkpoint

from recon.splat.camera import SplatCamera
from recon.splat.corrected_camera import view_of
from recon.splat.limits import ALPHA_FLOOR, COLOUR_MOST, QUAT_LEAST, Limits
from recon.splat.raster_types import RasterInputs, Render

_CHUNK = 1 << 20
"""Pixel-Gaussian pairs held at a time (8 MB a temporary)."""
_NEAR_AXIS = 0.02
"""Squared tangent below which a fisheye is computed by its series."""


def rasterize_reference(inputs: RasterInputs) -> Render:
    """Rasterise as `rasterize`, for tensors of any float dtype; computes in float64 and returns the input's
    dtype.
    """
    means, quats, scales, opacities, colours, camera, background, limits, stats, view = inputs
    dtype = means.dtype
    finite = (
        torch.isfinite(torch.cat([means, quats, scales, opacities[:, None], colours], dim=1)).all(dim=1)
        & (scales > 0).all(dim=1)
        & (quats.abs() >= QUAT_LEAST).any(dim=1)
        & (opacities >= 0)
        & (colours.abs() <= COLOUR_MOST).all(dim=1)
    )
    usable = torch.nonzero(finite)[:, 0]
    means, quats, scales, opacities, colours = (
        tensor[usable].double() for tensor in (means, quats, scales, opacities, colours)
    )
    view = view_of(camera) if view is None else view
    mean2d, ellipse, depth, drawn = _project(means, quats, scales, camera, limits, view)
    deviation = ellipse.detach()[:, [0, 2]].amax(dim=1).sqrt()
    degenerate = drawn & ~(deviation <= limits.max_sigma)
    culled = len(finite) - len(usable) + int(degenerate.sum())
    floor = alpha_floor(colours, limits)
    opacities = opacities + (opacities.clamp(max=limits.alpha_max) - opacities).detach()
    drawn = drawn & ~degenerate & (opacities.detach() >= floor)

    # Ties in depth keep the order of the input, and depth is compared in float32, as in the fast paths.
    index = torch.nonzero(drawn)[:, 0]
    index = index[torch.sort(depth.detach()[index].float(), stable=True).indices]
    mean2d, ellipse, floor = mean2d[index], ellipse[index], floor[index]
    opacities, colours, ids = opacities[index], colours[index], usable[index]
    back = torch.zeros(colours.shape[1], dtype=torch.float64) if background is None else background.double()
    rows = camera.height * camera.width
    step = max(1, _CHUNK // max(1, len(index)))
    images, alphas, touched = [], [], torch.zeros(len(index), dtype=torch.bool)
    weight, total, net = torch.zeros(3, len(index), dtype=torch.float64)
    composite = partial(_composite, pulls=None if stats is None else (total, net))
    for start in range(0, rows, step):
        number = torch.arange(start, min(start + step, rows))
        pixels = torch.stack([number % camera.width, number // camera.width], dim=1) + 0.5
        image, alpha, peak, hit = checkpoint(
            composite, mean2d, ellipse, opacities, colours, floor, back, pixels, limits.t_min,
            use_reentrant=False,
        )  # fmt: skip
        images.append(image)
        alphas.append(alpha)
        weight = torch.maximum(weight, peak)
        touched |= hit
    if stats is not None and mean2d.requires_grad:
        a, b, c, _ = ellipse.detach().unbind(dim=1)
        deviation = (0.5 * (a + c) + (0.25 * (a - c) ** 2 + b**2).sqrt()).sqrt()
        places, shown = ids[touched], touched

        def count(_: torch.Tensor) -> None:
            radius, pull, largest = torch.zeros(3, len(inputs.means), dtype=torch.float64)
            radius[places], largest[places] = 3 * deviation[shown], weight[shown]
            pull[places] = (total**2 - net**2).clamp(min=0).sqrt()[shown]
            stats.add(camera, radius.float(), pull, largest.float())

        # The gradient of the means is the last of all: by then every pixel has added its pull.
        mean2d.register_hook(count)  # type: ignore[no-untyped-call]
    shape = (camera.height, camera.width)
    return Render(
        image=torch.cat(images).reshape(*shape, len(back)).to(dtype),
        alpha=torch.cat(alphas).reshape(shape).to(dtype),
        counts=lambda: (culled, int(touched.sum()), rows * len(index)),
    )


def alpha_floor(colours: torch.Tensor, limits: Limits) -> torch.Tensor:
    """[N] the alpha below which each Gaussian is cut off; detached."""
    floor = torch.full_like(colours[:, 0], limits.alpha_min).detach()
    if limits.luminance_reference is not None:
        brightest = colours.detach().amax(dim=1).clamp(min=torch.finfo(torch.float64).tiny)
        floor = torch.minimum(floor, limits.tau * limits.luminance_reference / brightest)
    return floor.clamp(min=ALPHA_FLOOR)


def _project(
    means: torch.Tensor,
    quats: torch.Tensor,
    scales: torch.Tensor,
    camera: SplatCamera,
    limits: Limits,
    view: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Pixel means [N, 2], ellipses [N, 4], depths [N], and whether to draw [N].

    An ellipse: the covariance's xx, xy and yy, px^2, with blur, and its determinant.
    """
    rotation, (fx, fy, cx, cy) = view[:9].reshape(3, 3), view[12:16]
    points = means @ rotation.T + view[9:12]
    depth = points[:, 2]
    in_front = depth.detach() >= limits.near
    # Behind the camera the quotients below would overflow; those points get a harmless stand-in.
    safe = torch.where(in_front[:, None], points, points.new_tensor([0.0, 0.0, 1.0]))
    u, v = safe[:, 0] / safe[:, 2], safe[:, 1] / safe[:, 2]
    drawn = in_front & ((u * u + v * v).detach() < camera.monotone_radius2)
    distort = _distort_fisheye if camera.fisheye else _distort
    x, y, *_ = distort(u, v, view[16:])
    mean2d = torch.stack([fx * x + cx, fy * y + cy], dim=1)

    u_min, u_max, v_min, v_max = camera.tangent_bounds(limits.tangent_margin)
    u, v = u.clamp(u_min, u_max), v.clamp(v_min, v_max)
    _, _, xu, xv, yu, yv = distort(u, v, view[16:])
    inverse = 1 / safe[:, 2]
    jacobian = torch.stack(
        [
            torch.stack([fx * xu, fx * xv, -fx * (xu * u + xv * v)], dim=1),
            torch.stack([fy * yu, fy * yv, -fy * (yu * u + yv * v)], dim=1),
        ],
        dim=1,
    )
    root = jacobian * inverse[:, None, None] @ rotation @ rotation_matrices(quats) * scales[:, None, :]
    a, b, c = (root[:, 0] ** 2).sum(1), (root[:, 0] * root[:, 1]).sum(1), (root[:, 1] ** 2).sum(1)
    # a c - b^2 would lose all digits of a long needle; the sum of squared minors does not (Cauchy-Binet).
    minors = torch.linalg.cross(root[:, 0], root[:, 1])
    determinant = (minors**2).sum(1) + limits.blur * (a + c) + limits.blur**2
    ellipse = torch.stack([a + limits.blur, b, c + limits.blur, determinant], dim=1)
    return mean2d, ellipse, depth, drawn


def _distort(u: torch.Tensor, v: torch.Tensor, lens: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """Distorted tangents x, y and their derivatives xu, xv, yu, yv. lens [4]: k1, k2, p1, p2."""
    k1, k2, p1, p2 = lens
    r2 = u * u + v * v
    radial = 1 + r2 * (k1 + r2 * k2)
    slope = 2 * k1 + 4 * r2 * k2  # d radial / du = slope * u
    x = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)
    y = v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v
    xu = radial + slope * u * u + 2 * p1 * v + 6 * p2 * u
    yv = radial + slope * v * v + 6 * p1 * v + 2 * p2 * u
    xv = slope * u * v + 2 * p1 * u + 2 * p2 * v
    return x, y, xu, xv, xv, yv


def _distort_fisheye(u: torch.Tensor, v: torch.Tensor, lens: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """The same of a fisheye. lens [4]: k1, k2, k3, k4."""
    s = u * u + v * v
    near = s < _NEAR_AXIS
    far = torch.where(near, 1.0, s)
    along = 1 / (1 + s)  # d theta / dr
    # theta / r and what turns it with s; on the axis both are quotients of zeros, and their series is used.
    terms = [(-1) ** i / (2 * i + 1) for i in range(12)]
    series = sum(c * s**i for i, c in enumerate(terms))
    turning = sum(2 * i * c * s ** (i - 1) for i, c in enumerate(terms) if i)
    h = torch.where(near, series, torch.atan(far.sqrt()) / far.sqrt())
    w = torch.where(near, turning, (along - h) / far)  # 2 dh / ds
    q = h * h * s  # theta^2
    powers = torch.stack([q**i for i in range(5)])
    one = torch.cat([torch.ones_like(lens[:1]), lens])[:, None]
    polynomial = (one * powers).sum(0)
    rising = sum(i * one[i] * powers[i - 1] for i in range(1, 5))  # its derivative by q
    radial = h * polynomial
    slope = w * polynomial + 2 * h * h * along * rising  # d radial / du = slope * u
    return (
        u * radial,
        v * radial,
        radial + slope * u * u,
        slope * u * v,
        slope * u * v,
        radial + slope * v * v,
    )


def rotation_matrices(quats: torch.Tensor) -> torch.Tensor:
    """Rotations [N, 3, 3] of quaternions wxyz [N, 4], normalised first."""
    largest = quats.detach().abs().amax(dim=1, keepdim=True)
    scaled = quats / largest
    w, x, y, z = (scaled / scaled.norm(dim=1, keepdim=True)).unbind(dim=1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, dim=1) for row in rows], dim=1)


def _composite(
    mean2d: torch.Tensor,
    ellipse: torch.Tensor,
    opacities: torch.Tensor,
    colours: torch.Tensor,
    floor: torch.Tensor,
    background: torch.Tensor,
    pixels: torch.Tensor,
    t_min: float,
    pulls: tuple[torch.Tensor, torch.Tensor] | None,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Blend sorted Gaussians over `pixels` [P, 2]: colours [P, C], alphas [P], peak weights [N], hits [N].

    Going back adds to `pulls`, both [N], the sums over these pixels of |s| and of s, alpha d loss / d alpha.
    """
    if len(mean2d) == 0:
        # A sum of nothing, which keeps the graph: the inputs have a gradient, of zeros.
        zero = mean2d.sum() + ellipse.sum() + opacities.sum() + colours.sum()
        none = torch.zeros(0, dtype=torch.float64)
        return background.expand(len(pixels), -1) + zero, zero.expand(len(pixels)), none, none.bool()
    a, b, _, determinant = ellipse.unbind(dim=1)
    dx = pixels[:, :1] - mean2d[:, 0]
    dy = pixels[:, 1:] - mean2d[:, 1]
    q = dx * dx / a + (a * dy - b * dx) ** 2 / (a * determinant)  # [P, N], a sum of squares
    reach = 2 * torch.log(opacities.detach() / floor)
    hit = q.detach() <= reach
    alpha = torch.where(hit, opacities * torch.exp(-0.5 * q.clamp(max=200.0)), 0.0)
    # The product before each layer never grows, so layers beyond the cut-off are exactly those below it.
    with torch.no_grad():
        before = _exclusive_product(1 - alpha)
        alive = before >= t_min
    alpha = torch.where(alive, alpha, 0.0)
    if pulls is not None and alpha.requires_grad:
        shares, (total, net) = alpha.detach(), pulls

        def add(gradient: torch.Tensor) -> None:
            total.add_((shares * gradient).abs().sum(dim=0))
            net.add_((shares * gradient).sum(dim=0))

        alpha.register_hook(add)  # type: ignore[no-untyped-call]
    before = _exclusive_product(1 - alpha)
    weight = alpha * before
    remaining = before[:, -1] * (1 - alpha[:, -1])
    image = weight @ colours + remaining[:, None] * background
    return image, 1 - remaining, weight.detach().amax(dim=0), (hit & alive).any(dim=0)


def _exclusive_product(factors: torch.Tensor) -> torch.Tensor:
    """[P, N] product of all factors before each."""
    ones = torch.ones_like(factors[:, :1])
    return torch.cumprod(torch.cat([ones, factors[:, :-1]], dim=1), dim=1)
