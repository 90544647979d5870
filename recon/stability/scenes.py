"""Scenes at the ends of what a rasteriser is asked, small enough for the float64 oracle; seeded."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import torch

from recon.splat import Limits, SplatCamera
from recon.stability.workloads import view, workload

LENS = (-0.2, 0.06, 0.01, -0.008)
"""k1, k2, p1, p2."""


@dataclass(frozen=True)
class Case:
    """means, quats, scales, opacities, colours in float64 (values that float32 holds) and how to see them."""

    tensors: list[torch.Tensor]
    camera: SplatCamera
    limits: Limits = field(default_factory=Limits)
    background: torch.Tensor | None = None
    flat: bool = False
    """True if nothing in the image depends on the places or sizes of the Gaussians."""


def camera(
    width: int = 40, height: int = 30, depth: float = 3.0, turn: float = 0.3, bent: bool = False
) -> SplatCamera:
    """Camera turned about y, in front of the origin.

    Args:
        width: Of the picture, px; the focal lengths follow from it.
        height: Of the picture, px.
        depth: Distance from the camera to the origin, along its axis; negative where the origin is behind it.
        turn: About y, radians.
        bent: True for a lens with the distortion `LENS`.

    Returns:
        The camera, with its pose in the coordinates of the scene.
    """
    motion = np.eye(4)
    motion[0, 0] = motion[2, 2] = math.cos(turn)
    motion[0, 2], motion[2, 0] = math.sin(turn), -math.sin(turn)
    motion[2, 3] = depth
    lens = LENS if bent else (0.0, 0.0, 0.0, 0.0)
    return SplatCamera(motion, 0.9 * width, 0.95 * width, 0.48 * width, 0.53 * height, width, height, *lens)


def cloud(seed: int, count: int = 60, size: float = 0.1, spread: float = 0.7) -> list[torch.Tensor]:
    """Gaussians of all shapes around the origin."""
    rng = np.random.default_rng(seed)
    return _exact(
        rng.normal(0, spread, (count, 3)),
        rng.normal(0, 1, (count, 4)),
        size * np.exp(0.5 * rng.normal(0, 1, (count, 3))),
        rng.uniform(0.1, 0.99, count),
        rng.uniform(0.0, 1.0, (count, 3)),
    )


def _exact(*values: np.ndarray) -> list[torch.Tensor]:
    return [torch.tensor(value, dtype=torch.float32).double() for value in values]


def planes(opacities: list[float], light: list[float], limits: Limits) -> Case:
    """Gaussians so wide that the image sees them as planes, front to back."""
    n = len(light)
    means = np.stack([np.zeros(n), np.zeros(n), 2 + np.arange(n) / n], axis=1)
    quats = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    scales = np.tile([1e6, 1e6, 1e-3], (n, 1))
    tensors = _exact(means, quats, scales, np.array(opacities), np.tile(np.array(light)[:, None], (1, 3)))
    return Case(tensors, camera(24, 18, 0.0, 0.0), limits, flat=True)


def contrast(seed: int, count: int, width: int, height: int, ordered: bool, stops: int = 40) -> Case:
    """The `object` workload with radiance over 2^stops below 1: from left to right, or at random."""
    means, quats, scales, opacities, colours = (t.detach().double() for t in workload("object", count, seed))
    rng = np.random.default_rng(seed)
    place = means[:, 1].numpy() / 2 + 0.5 if ordered else rng.uniform(0, 1, count)
    power = np.clip(-stops * place + rng.uniform(-1.5, 1.5, count), -stops, 0)
    tint = 0.2 + 0.8 * colours.numpy()
    colours = torch.tensor(2.0 ** power[:, None] * tint, dtype=torch.float32).double()
    limits = Limits.for_scene(2.0**-stops, 1.0)
    return Case([means, quats, scales, opacities, colours], view("object", width, height, turn=0.0), limits)


def needles(length: float) -> Case:
    """Gaussians of which one axis is a billion times the others."""
    tensors = cloud(3, 12)
    tensors[2] = _exact(np.tile([length, length * 1e-9, length * 1e-9], (12, 1)))[0]
    return Case(tensors, camera())


def poisoned(seed: int) -> Case:
    """Every third Gaussian has one value that is not finite or degenerate."""
    tensors = cloud(seed, 90)
    bad = [math.nan, math.inf, -math.inf, 3e38]
    for number, i in enumerate(range(0, 90, 3)):
        tensor = tensors[number % 5]
        tensor.view(90, -1)[i, 0] = (-1.0 if number % 5 == 3 else bad[3]) if number >= 15 else bad[number % 3]
    return Case(tensors, camera())


def _around(tensors: list[torch.Tensor]) -> list[torch.Tensor]:
    """Variant with the first Gaussian large and around the camera, its centre just beyond the near plane."""
    tensors[0][0] = torch.tensor([0.0, 0.0, -2.98]).double()
    tensors[2][0] = torch.tensor([2.0, 1.5, 1.0]).double()
    return tensors


def _near(seed: int) -> Case:
    tensors = cloud(seed, 40, 0.05)
    tensors[0] = _exact(np.random.default_rng(seed).uniform(-0.5, 0.5, (40, 3)))[0]
    return Case(tensors, camera(depth=0.3, bent=True))


def cases(quick: bool, seed: int) -> dict[str, Callable[[], Case]]:
    """All scenes, by what is extreme about them."""
    size = (1500, 80, 60) if quick else (3000, 120, 90)
    back = torch.tensor([0.3, 0.2, 0.5]).double()

    def card(layers: int, opacity: float, contrast: float) -> Case:
        limits = Limits.for_scene(1.0, contrast)
        return planes([opacity] * layers + [1.0], [1.0] * layers + [contrast], limits)

    def scaled(power: int) -> Case:
        case = contrast(seed, *size, ordered=True)
        factor = 2.0**power
        reference = case.limits.luminance_reference or 1.0
        tensors = [*case.tensors[:4], case.tensors[4] * factor]
        return replace(
            case, tensors=tensors, limits=replace(case.limits, luminance_reference=reference * factor)
        )

    return {
        "2^40 (12 decades), left to right": lambda: contrast(seed, *size, ordered=True),
        "2^40 (12 decades), at random": lambda: contrast(seed, *size, ordered=False),
        "2^40 times 2^20": lambda: scaled(20),
        "2^40 times 2^-20": lambda: scaled(-20),
        "card of 1 layer before 2^12": lambda: card(1, 1.0, 2.0**12),
        "card of 1 layer before 2^20": lambda: card(1, 1.0, 2.0**20),
        "card of 2 layers before 2^20": lambda: card(2, 1 - 2.0**-14, 2.0**20),
        "card of 300 layers before 2^20": lambda: card(300, 0.1, 2.0**20),
        "lens": lambda: Case(cloud(seed + 2), camera(bent=True), background=back),
        "opaque": lambda: Case([*cloud(seed + 5)[:3], torch.ones(60).double(), cloud(seed + 5)[4]], camera()),
        "near plane, lens": lambda: _near(seed + 6),
        "camera inside": lambda: Case(_around(cloud(seed + 8)), camera(turn=0.0)),
        "all behind": lambda: Case(cloud(seed + 8), camera(depth=-50.0), background=back),
        "poison": lambda: poisoned(seed + 9),
        **{f"needles 1e9:1 of {length:.0e}": partial(needles, length) for length in (1e-1, 1e3, 1e7)},
        "1x1": lambda: Case(cloud(seed + 1), replace(camera(1, 1), fx=20.0, fy=20.0), background=back),
        "17x3": lambda: Case(cloud(seed + 1), camera(17, 3), background=back),
        "4096x16": lambda: Case(cloud(seed + 1, 30), camera(4096, 16), background=back),
        "1 Gaussian": lambda: Case(cloud(seed + 2, 1, spread=0.1), camera(), background=back),
        "0 Gaussians": lambda: Case(cloud(seed, 0), camera(), background=back),
    }
