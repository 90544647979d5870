"""Drawing of display values as viewers do it: each has its own blur, and its own end of colours.

As their programs have it (PlayCanvas 2.23, Spark 2.2), and as pictures of their canvases show it
(`tests/foreign_viewers/`).
"""

from dataclasses import replace

import torch

from recon.scene.appearance import PlainHarmonics
from recon.scene.gaussians import Renderer
from recon.scene.sampling import Sampling
from recon.splat import Limits

MOST_CODE = 4.0
"""Largest sRGB code that PlayCanvas and SuperSplat hold of a Gaussian: light of 25 times white."""
PLAYCANVAS_BLUR = 0.3 / 4
"""Variance, px^2: PlayCanvas adds 0.3 in halves of a pixel."""
SPARK_BLUR = 0.3
"""Variance, px^2, for which Spark makes up by the opacity."""


def playcanvas() -> Renderer:
    """Renderer in the manner of PlayCanvas and SuperSplat."""
    return Renderer(PlainHarmonics(), replace(Limits.gsplat(), blur=PLAYCANVAS_BLUR))


def spark(count: int) -> Renderer:
    """Renderer of `count` Gaussians in the manner of Spark; colours have to be within 0..1."""
    finest = Sampling(torch.zeros(count), torch.zeros(count))
    return Renderer(PlainHarmonics(), replace(Limits.gsplat(), blur=SPARK_BLUR), sampling=finest)


def viewers_of(count: int, end: float) -> tuple[Renderer, ...]:
    """Renderers of `count` Gaussians whose colours go up to `end`: above 1 those of PlayCanvas alone."""
    return (playcanvas(),) if end > 1 else (playcanvas(), spark(count))
