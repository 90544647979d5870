"""The rasteriser on a GPU: its tests, then its speed beside gsplat's, in one call.

    python -m bench.speed.gpu [--quick] [--json] [--write] [--seed 0]

Needs a CUDA device, Triton, and pytest; gsplat is measured where it is installed and builds. Milliseconds
are the median of CUDA events over repeated renders. Both draw the same Gaussians at the cut-offs of 3DGS;
ours also at cut-offs that are right for high contrast. --write puts the table into bench/results/gpu.md.
"""

import argparse
import importlib.util
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.autograd import backward

from bench.speed.drawn import drawn
from bench.support.record import arguments, deliver, machine, words
from recon.splat import Limits, SplatCamera
from recon.stability.workloads import view, workload

ROOT = Path(__file__).parents[2]
SIZES = ((1920, 1080), (3840, 2160))
COUNTS = (100_000, 1_000_000, 3_000_000)
CUTS = {"3DGS": Limits.gsplat(), "luminance-aware over 2^20": Limits.for_scene(2.0**-20, 1.0)}

Render = Callable[[], torch.Tensor]


def milliseconds(run: Callable[[], Any], rounds: int) -> float:
    """Median time of a call on the device, after two that warm it up."""
    times = []
    event: Callable[[], torch.cuda.Event] = partial(torch.cuda.Event, enable_timing=True)
    for number in range(rounds + 2):
        begin, end = event(), event()
        begin.record()
        run()
        end.record()
        end.synchronize()
        if number >= 2:
            times.append(begin.elapsed_time(end))
    return float(np.median(times))


def timed(render: Render, tensors: list[torch.Tensor], pull: torch.Tensor, rounds: int) -> dict[str, float]:
    """Forward, and forward with backward."""

    def forward() -> None:
        with torch.no_grad():
            render()

    def both() -> None:
        for tensor in tensors:
            tensor.grad = None
        backward(render(), pull)

    return {"forward_ms": milliseconds(forward, rounds), "both_ms": milliseconds(both, rounds)}


def by_gsplat(tensors: list[torch.Tensor], camera: SplatCamera) -> Render:
    """The same picture by gsplat (Ye et al., arXiv 2409.06765); ImportError where it does not build."""
    from gsplat import rasterization  # type: ignore[import-not-found]

    means, quats, scales, opacities, colours = tensors
    motion = torch.tensor(camera.cam_from_world, dtype=torch.float32, device=means.device)[None]
    lens = [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]
    matrix = torch.tensor([lens], dtype=torch.float32, device=means.device)

    def render() -> torch.Tensor:
        images: torch.Tensor
        images, _, _ = rasterization(
            means, quats, scales, opacities, colours, motion, matrix, camera.width, camera.height,
            packed=False,
        )  # fmt: skip
        return images[0]

    render()
    return render


def measure(options: argparse.Namespace) -> dict[str, Any]:
    tests = sorted(str(path) for path in (ROOT / "tests" / "recon" / "splat").glob("test_gpu*.py"))
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", *tests]
    passed = subprocess.run(command, cwd=ROOT, check=False).returncode == 0
    rows = []
    for width, height in options.sizes:
        for count in options.counts:
            tensors = [
                tensor.detach().to("cuda").requires_grad_()
                for tensor in workload("object", count, options.seed)
            ]
            camera = view("object", width, height)
            pull = torch.randn(height, width, 3, generator=torch.Generator().manual_seed(0)).to("cuda")

            def ours(
                limits: Limits, tensors: list[torch.Tensor] = tensors, camera: SplatCamera = camera
            ) -> Render:
                return lambda: drawn(tensors, camera, limits).image

            renders = {f"ours, {label}": ours(limits) for label, limits in CUTS.items()}
            if importlib.util.find_spec("gsplat"):
                renders["gsplat"] = by_gsplat(tensors, camera)
            for label, render in renders.items():
                row = {"size": f"{width}x{height}", "gaussians": count, "what": label}
                rows.append(row | timed(render, tensors, pull, options.rounds))
    device = torch.cuda.get_device_name()
    return {"machine": machine(), "device": device, "tests_passed": passed, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# The rasteriser on a GPU",
        "",
        f"`python -m bench.speed.gpu --write`: {result['device']}; {words(result['machine'])}. "
        f"The tests {'passed' if result['tests_passed'] else 'FAILED'} on it.",
        "",
        "| size | Gaussians | | forward, ms | forward + backward, ms |",
        "|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        cells = [row["size"], f"{row['gaussians']:,}", row["what"]]
        cells += [f"{row['forward_ms']:.2f}", f"{row['both_ms']:.2f}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if not torch.cuda.is_available():
        sys.exit("bench/speed/gpu.py: torch sees no CUDA device here, so there is nothing to measure.")
    options.sizes, options.counts, options.rounds = SIZES, COUNTS, 20
    if options.quick:
        options.sizes, options.counts, options.rounds = SIZES[:1], COUNTS[:1], 5
    result = measure(options)
    deliver(options, "gpu", result, report(result))


if __name__ == "__main__":
    main()
