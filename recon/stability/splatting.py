"""The float32 kernels of the rasteriser against its float64 oracle, at the extremes.

Relative errors are those of each pixel channel and of each Gaussian's own gradient vector (not of a norm
over all, which only the brightest would decide). The slope of an opacity is one number, a sum over pixels of
either sign that may come out near nothing: its error is relative to the sum of their sizes.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from imaging.compute import threads
from imaging.progress import Progress, unreported
from imaging.stress_case import StressCase
from recon.splat import Limits, Render, SplatCamera, SplatStats, rasterize
from recon.splat.corrected_camera import DELTA
from recon.splat.torch_threads import torch_on_one_thread
from recon.stability.scenes import Case, cases, contrast

NAMES = ("means", "quats", "scales", "opacities", "colours")
STEPS = torch.tensor([1e-3] * 6 + [0.1] * 4 + [1e-3] * 4).double()
"""Steps of a camera_delta: about a twentieth of a pixel each, the units its gradient is compared in."""
PIXELS, GRADIENTS = 1e-4, 1e-2
"""Limits of the worst relative error: of a channel of a pixel, of a Gaussian's gradient."""
LAYERS = 1e-2
"""Limit of the relative error of the transmittance of a million faint layers before one pixel: their alphas
alone have 24 bits.
"""


def splatting(quick: bool, seed: int = 0, progress: Progress = unreported) -> Iterator[StressCase]:
    """Every scene's image and gradients, a million layers by hand, and what may not change a bit."""
    scenes = cases(quick, seed)
    if quick:  # what another unit of light changes is asked below, to the bit
        scenes = {name: make for name, make in scenes.items() if " times 2^" not in name}
    for done, (name, make) in enumerate(scenes.items()):
        progress(f"splatting: {name}", done, len(scenes))
        case = make()
        with torch_on_one_thread():  # the oracle's operations are too small to share
            figures = accuracy(case, seed)
        yield _row(name, "pixels", _worst(figures, "forward"), PIXELS)
        # Layers of one colour: the slope of an opacity is a difference of equals, which says nothing.
        kinds = ("colours",) if case.flat else (*NAMES, "camera")
        yield _row(name, "gradients", max(_worst(figures, kind) for kind in kinds), GRADIENTS)
        if name.startswith("card"):
            with torch.no_grad():
                image = draw(case, torch.float32, grad=False)[0].image
            yield StressCase.of(
                "splatting", name, "the card's light", "truth", float((image - 1).abs().max()), LAYERS
            )
    layers = max(million().values())
    yield StressCase.of("splatting", "a million Gaussians before one pixel", "all", "truth", layers, LAYERS)
    for changed, count in exactness(seed, quick).items():
        yield StressCase.of("splatting", changed, "numbers that differ", "truth", float(count), 0.0)


def _row(case: str, what: str, error: float, limit: float) -> StressCase:
    return StressCase.of("splatting", case, what, "float64", error, limit)


def _worst(figures: dict[str, Any], kind: str) -> float:
    """The worst error; NaN, which no limit holds, where anything is not finite."""
    if not figures["finite"]:
        return math.nan
    return 0.0 if figures[kind] is None else float(figures[kind]["worst"])


def draw(
    case: Case, dtype: torch.dtype, grad: bool = True, stats: SplatStats | None = None
) -> tuple[Render, list[torch.Tensor], torch.Tensor]:
    """A render, its tensors and its camera_delta, of which the last two may have gradients."""
    tensors = [tensor.to(dtype).clone().requires_grad_(grad) for tensor in case.tensors]
    delta = torch.zeros(DELTA, dtype=torch.float64, requires_grad=grad)
    back = None if case.background is None else case.background.to(dtype)
    means, quats, scales, opacities, colours = tensors
    render = rasterize(means, quats, scales, opacities, colours, case.camera, back, case.limits, stats, delta)
    return render, tensors, delta


def gradients(
    case: Case, dtype: torch.dtype, seed: int
) -> tuple[torch.Tensor, dict[str, torch.Tensor], torch.Tensor]:
    """The image and the gradients of a residual that is relative to each pixel, of either sign.

    And [N] the sizes of what pixels add to the slope of each opacity, added up.
    """
    stats = SplatStats(len(case.tensors[0]))
    render, tensors, delta = draw(case, dtype, stats=stats)
    image = render.image.detach().double()
    reference = case.limits.luminance_reference or 1e-6
    pull = torch.randn(image.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    if render.image.requires_grad:
        # The residual is the float64 one in both, so that only the rasteriser differs.
        with torch.no_grad():
            truth = draw(case, torch.float64, grad=False)[0].image
        render.image.backward((pull / (truth + reference)).to(dtype))  # type: ignore[no-untyped-call]
    slopes = {name: _slope(t) for name, t in zip(NAMES, tensors, strict=True)}
    return image, slopes | {"camera": (_slope(delta) * STEPS)[None]}, _sizes(case, slopes["opacities"], stats)


def _sizes(case: Case, slopes: torch.Tensor, stats: SplatStats) -> torch.Tensor:
    """Sums over pixels of |d loss / d opacity| [N], from what is left of them and how they pull apart."""
    side = 1.5 * max(case.camera.width, case.camera.height)
    pull = stats.tension * stats.radius.double() / side  # sqrt((sum |s|)^2 - (sum s)^2), s = o d loss / d o
    opacities = case.tensors[3].double().clamp(max=case.limits.alpha_max)
    return (pull.square() / opacities.square().clamp_min(1e-300) + slopes.square()).sqrt()


def _slope(tensor: torch.Tensor) -> torch.Tensor:
    return torch.zeros_like(tensor).double() if tensor.grad is None else tensor.grad.double()


def spread(error: torch.Tensor) -> dict[str, float] | None:
    """Median, 99th percentile and worst of relative errors; None without errors."""
    if not error.numel():
        return None
    values = error.flatten().numpy()
    return {
        "median": float(np.median(values)),
        "p99": float(np.quantile(values, 0.99)),
        "worst": float(values.max()),
    }


def pixels(ours: torch.Tensor, truth: torch.Tensor) -> dict[str, float] | None:
    """Relative errors of the channels of all pixels that are not black."""
    lit = truth.abs() > 0
    return spread(((ours - truth).abs()[lit]) / truth.abs()[lit])


def vectors(
    ours: torch.Tensor, truth: torch.Tensor, norm: torch.Tensor | None = None
) -> dict[str, float] | None:
    """Errors of the gradients of all Gaussians that have one, relative to their lengths or to `norm` [N]."""
    if not len(truth):
        return None
    a, b = ours.reshape(len(ours), -1), truth.reshape(len(truth), -1)
    norm = b.norm(dim=1) if norm is None else norm
    return spread((a - b).norm(dim=1)[norm > 0] / norm[norm > 0])


def accuracy(case: Case, seed: int) -> dict[str, Any]:
    """Errors of one scene against the oracle with the same cut-offs."""
    image, slopes, _ = gradients(case, torch.float32, seed)
    truth, expected, sizes = gradients(case, torch.float64, seed)
    lit = truth[truth > 0]
    without = ("means", "quats", "scales", "camera") if case.flat else ()
    finite = all(bool(torch.isfinite(value).all()) for value in (image, *slopes.values()))
    return {
        "gaussians": len(case.tensors[0]),
        "size": f"{case.camera.width}x{case.camera.height}",
        "decades": round(float((lit.max() / lit.min()).log10()), 1) if len(lit) else 0.0,
        "finite": finite,
        "forward": pixels(image, truth),
        **{
            name: None
            if name in without
            else vectors(slopes[name], expected[name], sizes if name == "opacities" else None)
            for name in expected
        },
    }


def exactness(seed: int, quick: bool = False) -> dict[str, int]:
    """Numbers that differ where none may: image, alpha and gradients of a scene over 2^40."""
    case = contrast(seed, 1500, 80, 60, ordered=True)
    before = threads.thread_count()
    plain = _bits(case, seed)
    differing = {"light times 2^k, k = -20..20": 0, "1, 2, 3 and 7 threads": 0, "another order": 0}
    for power in range(-20, 21, 10 if quick else 1):
        factor = 2.0**power
        limits = replace(case.limits, luminance_reference=2.0**-40 * factor)
        scaled = replace(case, tensors=[*case.tensors[:4], case.tensors[4] * factor], limits=limits)
        image, alpha, *slopes = _bits(scaled, seed)
        back = [image / factor, alpha, *(slope / factor for slope in slopes[:4]), slopes[4]]
        differing["light times 2^k, k = -20..20"] += _different(plain, back)
    try:
        for count in (1, 2, 3, 7):
            threads.set_threads(count)
            differing["1, 2, 3 and 7 threads"] += _different(plain, _bits(case, seed))
    finally:
        threads.set_threads(before)
    order = torch.from_numpy(np.random.default_rng(seed).permutation(len(case.tensors[0])))
    image, alpha, *slopes = _bits(replace(case, tensors=[t[order] for t in case.tensors]), seed)
    place = torch.argsort(order)
    differing["another order"] = _different(plain, [image, alpha, *(slope[place] for slope in slopes)])
    return differing


def _bits(case: Case, seed: int) -> list[torch.Tensor]:
    """Image, alpha and the gradients of all Gaussians in float32."""
    render, tensors, _ = draw(case, torch.float32)
    generator = torch.Generator().manual_seed(seed)
    render.image.backward(torch.randn(render.image.shape, generator=generator))  # type: ignore[no-untyped-call]
    return [render.image.detach(), render.alpha.detach(), *(_gradient(tensor) for tensor in tensors)]


def _gradient(tensor: torch.Tensor) -> torch.Tensor:
    return torch.zeros_like(tensor) if tensor.grad is None else tensor.grad


def _different(first: list[torch.Tensor], second: list[torch.Tensor]) -> int:
    return sum(int((a != b).sum()) for a, b in zip(first, second, strict=True))


def million() -> dict[str, float]:
    """A million faint Gaussians before one pixel: alpha and the slopes of their opacities, by hand."""
    n, opacity = 1_000_000, 2.0**-16
    camera = SplatCamera(np.eye(4), fx=10, fy=10, cx=0.5, cy=0.5, width=1, height=1)
    means = torch.zeros(n, 3)
    means[:, 2] = torch.linspace(1, 3, n)
    quats = torch.tensor([[1.0, 0, 0, 0]]).expand(n, 4).contiguous()
    alphas = torch.full((n,), opacity, requires_grad=True)
    limits = Limits(alpha_min=2.0**-20)
    render = rasterize(
        means, quats, torch.full((n, 3), 0.01), alphas, torch.ones(n, 3), camera, limits=limits
    )
    render.alpha.sum().backward()  # type: ignore[no-untyped-call]
    through = math.exp(n * math.log1p(-opacity))
    slope = through / (1 - opacity)
    return {
        "alpha": abs(float(render.alpha.detach()) / (1 - through) - 1),
        "image": abs(float(render.image.detach()[0, 0, 0]) / (1 - through) - 1),
        "opacities": float((_gradient(alphas).double() / slope - 1).abs().max()),
    }
