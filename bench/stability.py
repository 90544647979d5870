"""How right the float32 rasteriser is at the extremes, against float64 and against the truth.

    python bench/stability.py [--quick] [--json] [--write] [--seed 0]

Relative errors are those of each pixel channel and of each Gaussian's own gradient vector (not of a norm
over all, which only the brightest would decide). --quick uses smaller images. --write puts the tables into
bench/results/stability.md and the numbers into bench/results/stability.json.
"""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from extremes import Case, cases, contrast
from record import RESULTS, arguments, machine, publish, words
from splat import CUTS

from imaging import store
from recon import threads
from recon.splat import Limits, Render, SplatCamera, rasterize
from recon.splat.moved import DELTA

NAMES = ("means", "quats", "scales", "opacities", "colours")
WAYS = (("left to right", True), ("at random", False))
STEPS = torch.tensor([1e-3] * 6 + [0.1] * 4 + [1e-3] * 4).double()
"""Of a camera_delta: about a twentieth of a pixel each, the units its gradient is compared in."""
UNCUT = Limits(alpha_min=2.0**-64, t_min=0.0)
FIXED = {
    "alpha 1e-7, T 1e-8": Limits(alpha_min=1e-7),
    "alpha 1e-8, T 1e-10": Limits(alpha_min=1e-8, t_min=1e-10),
    "alpha 1e-10, T 1e-12": Limits(alpha_min=1e-10, t_min=1e-12),
    "alpha 1e-12, T 1e-13": Limits(alpha_min=1e-12, t_min=1e-13),
    "alpha 1e-14, T 1e-14": Limits(alpha_min=1e-14, t_min=1e-14),
}


def draw(
    case: Case, dtype: torch.dtype, grad: bool = True
) -> tuple[Render, list[torch.Tensor], torch.Tensor]:
    """A render, its tensors and its camera_delta, of which the last two may have gradients."""
    tensors = [tensor.to(dtype).clone().requires_grad_(grad) for tensor in case.tensors]
    delta = torch.zeros(DELTA, dtype=torch.float64, requires_grad=grad)
    back = None if case.background is None else case.background.to(dtype)
    render = rasterize(*tensors, case.camera, back, case.limits, None, delta)
    return render, tensors, delta


def gradients(case: Case, dtype: torch.dtype, seed: int) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The image and the gradients of a residual that is relative to each pixel, of either sign."""
    render, tensors, delta = draw(case, dtype)
    image = render.image.detach().double()
    reference = case.limits.luminance_reference or 1e-6
    pull = torch.randn(image.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    if render.image.requires_grad:
        # The residual is the float64 one in both, so that only the rasteriser differs.
        with torch.no_grad():
            truth = draw(case, torch.float64, grad=False)[0].image
        render.image.backward((pull / (truth + reference)).to(dtype))
    found = {name: _slope(t) for name, t in zip(NAMES, tensors, strict=True)}
    return image, found | {"camera": (_slope(delta) * STEPS)[None]}


def _slope(tensor: torch.Tensor) -> torch.Tensor:
    return torch.zeros_like(tensor).double() if tensor.grad is None else tensor.grad.double()


def spread(error: torch.Tensor) -> dict[str, float] | None:
    """Median, 99th percentile and worst of relative errors; None if there are none."""
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


def vectors(ours: torch.Tensor, truth: torch.Tensor) -> dict[str, float] | None:
    """Relative errors of the gradients of all Gaussians that have one."""
    if not len(truth):
        return None
    a, b = ours.reshape(len(ours), -1), truth.reshape(len(truth), -1)
    norm = b.norm(dim=1)
    return spread((a - b).norm(dim=1)[norm > 0] / norm[norm > 0])


def accuracy(case: Case, seed: int) -> dict[str, Any]:
    """Errors of one scene against the oracle with the same cut-offs."""
    image, found = gradients(case, torch.float32, seed)
    truth, expected = gradients(case, torch.float64, seed)
    lit = truth[truth > 0]
    without = ("means", "quats", "scales", "camera") if case.flat else ()
    finite = all(bool(torch.isfinite(value).all()) for value in (image, *found.values()))
    return {
        "gaussians": len(case.tensors[0]),
        "size": f"{case.camera.width}x{case.camera.height}",
        "decades": round(float((lit.max() / lit.min()).log10()), 1) if len(lit) else 0.0,
        "finite": finite,
        "forward": pixels(image, truth),
        **{name: None if name in without else vectors(found[name], expected[name]) for name in expected},
    }


def trade(seed: int, quick: bool) -> list[dict[str, Any]]:
    """Each cut-off's error over 2^20 and 2^40 against nothing cut off, in float64, and its work."""
    size = (1500, 80, 60) if quick else (3000, 120, 90)
    rows = []
    aware = {"luminance-aware over 2^40": Limits.for_scene(2.0**-40, 1.0)}
    for stops, label, ordered in ((s, *way) for s in (20, 40) for way in WAYS):
        case = contrast(seed, *size, ordered=ordered, stops=stops)
        with torch.no_grad():
            truth = draw(replace(case, limits=UNCUT), torch.float64, grad=False)[0].image
            for cut, limits in {**CUTS, **FIXED, **aware}.items():
                render = draw(replace(case, limits=limits), torch.float32, grad=False)[0]
                lost = (render.image.double() - truth).abs() / truth.clamp(min=2.0**-stops)
                rows.append(
                    {
                        "radiance": f"2^{stops}, {label}",
                        "cut_off": cut,
                        "pairs_per_pixel": round(render.pairs / truth[..., 0].numel(), 1),
                        **(spread(lost) or {}),
                        "share_beyond_1_percent": float((lost > 0.01).double().mean()),
                    }
                )
    return rows


def exactness(seed: int) -> dict[str, int]:
    """Numbers that differ where none may: image, alpha and gradients of a scene over 2^40."""
    case = contrast(seed, 1500, 80, 60, ordered=True)
    before = threads.thread_count()
    plain = _bits(case, seed)
    differing = {"light times 2^k, k = -20..20": 0, "1, 2, 3 and 7 threads": 0, "another order": 0}
    for power in range(-20, 21):
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
    render.image.backward(torch.randn(render.image.shape, generator=generator))
    return [render.image.detach(), render.alpha.detach(), *(tensor.grad for tensor in tensors)]


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
    render.alpha.sum().backward()
    through = math.exp(n * math.log1p(-opacity))
    slope = through / (1 - opacity)
    return {
        "alpha": abs(float(render.alpha.detach()) / (1 - through) - 1),
        "image": abs(float(render.image.detach()[0, 0, 0]) / (1 - through) - 1),
        "opacities": float((alphas.grad.double() / slope - 1).abs().max()),
    }


def measure(quick: bool, seed: int) -> dict[str, Any]:
    return {
        "machine": machine(),
        "seed": seed,
        "quick": quick,
        "scenes": {name: accuracy(make(), seed) for name, make in cases(quick, seed).items()},
        "million": million(),
        "exactness": exactness(seed),
        "trade": trade(seed, quick),
    }


def _number(value: Any) -> str:
    return f"{value:.1e}" if isinstance(value, float) else str(value)


def _table(rows: list[list[Any]], columns: list[str]) -> list[str]:
    head = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return head + ["| " + " | ".join(_number(cell) for cell in row) + " |" for row in rows]


def report(result: dict[str, Any]) -> str:
    """All tables, in Markdown."""
    scenes = result["scenes"]
    kinds = ["forward", *NAMES, "camera"]

    def part(name: str) -> list[list[Any]]:
        return [
            [label, *("-" if row[kind] is None else row[kind][name] for kind in kinds)]
            for label, row in scenes.items()
        ]

    text = [
        "# The rasteriser at the extremes",
        "",
        "Generated by `python bench/stability.py --write`"
        f"{' --quick' if result['quick'] else ''}, seed {result['seed']}. {words(result['machine'])}.",
        "",
        "Relative errors of the float32 kernels against the float64 oracle with the same cut-offs: of each "
        "channel of each pixel that is not black, and of each Gaussian's own gradient of a residual that is "
        "relative to the pixel; `camera` is the gradient of the pose and the lens. The layers of a card are "
        "all of one colour, so the slope of an opacity there is a difference of nearly equal colours, which "
        "float32 does not resolve: its relative error says nothing of the image.",
        "",
        "## Scenes",
        "",
    ]
    shapes = [
        [label, row["gaussians"], row["size"], str(row["decades"]), row["finite"]]
        for label, row in scenes.items()
    ]
    text += _table(shapes, ["scene", "Gaussians", "size", "decades in the image", "all finite"])
    for name, title in (("median", "Median"), ("p99", "99th percentile"), ("worst", "Worst")):
        text += ["", f"## {title} error", "", *_table(part(name), ["scene", *kinds])]
    text += ["", "## A million Gaussians before one pixel, against the product of their factors", ""]
    text += _table([list(result["million"].values())], list(result["million"]))
    text += ["", "## Numbers that differ where none may", ""]
    text += _table([list(pair) for pair in result["exactness"].items()], ["changed", "numbers that differ"])
    text += [
        "",
        "## What a cut-off costs and what it loses",
        "",
        "Radiance over 2^20 and 2^40, brightest 1; error of a pixel against float64 with nothing cut off, "
        "relative to the pixel or to the dimmest radiance that matters (2^-20, 2^-40), whichever is more.",
        "",
    ]
    columns = ["radiance", "cut_off", "pairs_per_pixel", "median", "p99", "worst", "share_beyond_1_percent"]
    rows = [[str(row[c]) if c == "pairs_per_pixel" else row[c] for c in columns] for row in result["trade"]]
    return "\n".join(text + _table(rows, [c.replace("_", " ") for c in columns])) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    torch.set_num_threads(1)  # the oracle's operations are too small to share
    result = measure(options.quick, options.seed)
    text = json.dumps(result, indent=1)
    print(text if options.json else report(result))
    if options.write:
        publish("stability", report(result))
        store.write_bytes(RESULTS / "stability.json", (text + "\n").encode())


if __name__ == "__main__":
    main()
