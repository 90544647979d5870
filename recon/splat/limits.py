"""Every constant of the rasteriser, in one place, with values that stay right at high contrast."""

import math
from dataclasses import dataclass

T_LEAST = 1e-30
"""Smallest stopping transmittance in float32: below it products would lose digits to denormals."""


CHANNELS_MOST = 16
"""Channels of light that a Gaussian may have: what a line of its table holds beside its shape."""


@dataclass(frozen=True)
class Limits:
    """Cut-offs of `rasterize`; run-time options, the same on every device.

    The usual values of 3DGS (alpha at most 0.99 and at least 1/255, transmittance at least 1e-4) are
    tuned for 8-bit colour. Behind a dark surface a 2^10 times brighter one leaks through 0.99 ten times
    brighter than the surface itself, and the edge of a Gaussian R times brighter than its surroundings
    is a step of R/255. The defaults here avoid both.
    """

    alpha_max: float = 1.0
    """Opacities above it are drawn as it, and keep the gradient that it has, so that they can come back.
    (3DGS clamps alpha, pixel by pixel, which differs by at most 1 - alpha_max.) 1 is safe: no gradient here
    divides by `1 - alpha`. One layer of 1 - 2^-24, the next float32 below, would still leak 6 % of a card
    in front of a 2^20 brighter plane."""
    t_min: float = 1e-8
    """A pixel is finished when its transmittance falls below this; the layer that crosses it still counts."""
    alpha_min: float = 1.0 / 255.0
    """A Gaussian does not touch the pixels where its alpha is below this (or below its lower floor, next)."""
    luminance_reference: float | None = None
    """The dimmest radiance that matters, in the units of the colours. When given, a Gaussian whose largest
    colour channel is L has the floor `min(alpha_min, tau * luminance_reference / L)`, so that what is cut
    off is always dimmer than `tau * luminance_reference`."""
    tau: float = 1e-3
    """Largest error of a cut-off, relative to `luminance_reference`."""
    near: float = 0.01
    """Gaussians whose centre is nearer than this (camera z, in the unit of the means) are not drawn. In scene
    coordinates (`recon.data.world`) the subject is about 1 away.
    """
    blur: float = 0.1
    """Variance added to every projected Gaussian, px^2: about that of a pixel's own square, 1/12
    (Mip-Splatting, Yu et al., arXiv 2311.16493, has 0.1; 3DGS 0.3, which no edge can be sharper than)."""
    tangent_margin: float = 0.3
    """The Jacobian of the projection is taken at most this fraction of half the field of view outside it."""
    max_sigma: float = 1e9
    """A Gaussian with a larger projected standard deviation, px, is degenerate: culled and counted."""

    def __post_init__(self) -> None:
        for name in ("alpha_max", "alpha_min", "tau", "near", "blur"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"Limits.{name} must be positive and finite, not {value}")
        if self.alpha_max > 1 or not 0 <= self.t_min < 1:
            raise ValueError("Limits.alpha_max must be at most 1 and Limits.t_min in [0, 1)")
        reference = self.luminance_reference
        if reference is not None and not (math.isfinite(reference) and reference > 0):
            raise ValueError(f"Limits.luminance_reference must be positive and finite, not {reference}")

    @classmethod
    def gsplat(cls) -> "Limits":
        """Limits of gsplat (alpha_max 0.999) and 3DGS, with which viewers draw and peers train."""
        return cls(alpha_max=0.999, t_min=1e-4, alpha_min=1.0 / 255.0, blur=0.3)

    @classmethod
    def for_scene(cls, dimmest: float, brightest: float) -> "Limits":
        """Limits for radiances from `dimmest`, the least that matters, to `brightest`.

        The transmittance at which a pixel is finished is chosen so that what is left behind, at most
        `brightest`, adds at most 1 % of `dimmest`.
        """
        return cls(t_min=min(1e-4, 1e-2 * dimmest / brightest), luminance_reference=dimmest)


ALPHA_FLOOR = 2.0**-64
"""No alpha floor is below this: float32 exponents stay in range, and less is invisible at any contrast."""

COLOUR_MOST = 1e30
"""A Gaussian with a brighter (or more negative) channel is degenerate: its gradient would overflow float32
even at pixels that it does not touch, and spoil those of others."""

QUAT_LEAST = 1e-20
"""A quaternion with no component as large as this has no direction: its gradient would overflow."""
