"""The rasteriser on a GPU: its check, its tests, then its speed and memory beside gsplat's, in one call.

    python -m bench.speed.gpu [--quick] [--json] [--write] [--seed 0]

Needs a GPU, Triton, and pytest; gsplat is measured where it is installed and builds, and `gpu.sh` beside this
file has more. Milliseconds are the median of CUDA events over repeated renders, memory is what torch held at
most, tensors of the scene included. Both draw the same Gaussians at the cut-offs of 3DGS;
ours also at cut-offs that are right for high contrast. --write puts the table into bench/results/gpu.md.
"""

import argparse
import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.autograd import backward

from bench.speed.drawn import drawn
from bench.support.record import arguments, deliver, machine, words
from imaging.compute import memory
from recon.splat import Limits, SplatCamera
from recon.stability.workloads import view, workload
from recon.train.devices.gpu_check import COUNT, compared, examined
from recon.train.devices.training_device import training_device

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

    torch.cuda.reset_peak_memory_stats()
    times = {"forward_ms": milliseconds(forward, rounds), "both_ms": milliseconds(both, rounds)}
    return {**times, "peak": torch.cuda.max_memory_allocated()}


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
    tests = sorted(str(path) for path in (ROOT / "tests" / "recon").rglob("test_gpu*.py"))
    check = examined(torch.device("cuda"))
    began = time.perf_counter()
    compared(torch.device("cuda"))
    check_seconds = time.perf_counter() - began
    command = [sys.executable, "-m", "pytest", "-q", "-n", "auto", *tests]
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
                with suppress(Exception):  # whatever building it raises
                    renders["gsplat"] = by_gsplat(tensors, camera)
            for label, render in renders.items():
                row = {"size": f"{width}x{height}", "gaussians": count, "what": label}
                with suppress(torch.OutOfMemoryError):  # its row has no figures
                    row |= timed(render, tensors, pull, options.rounds)
                rows.append(row)
    device = torch.cuda.get_device_name()
    return {
        "machine": machine(),
        "device": device,
        "check": check.in_words(),
        "check_seconds": check_seconds,
        "tests_passed": passed,
        "rows": rows,
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# The rasteriser on a GPU",
        "",
        f"`python -m bench.speed.gpu --write`: {result['device']}; {words(result['machine'])}. "
        f"The tests {'passed' if result['tests_passed'] else 'FAILED'} on it. Check of {COUNT} Gaussians, in "
        f"{result['check_seconds']:.2f} s: {result['check']}.",
        "",
        "| size | Gaussians | | forward, ms | forward + backward, ms | memory |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        cells = [row["size"], f"{row['gaussians']:,}", row["what"]]
        if "peak" in row:
            cells += [f"{row['forward_ms']:.2f}", f"{row['both_ms']:.2f}", memory.text(row["peak"])]
        else:
            cells += ["", "", "too little"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--present", action="store_true", help="only say whether there is a GPU")
    options = parser.parse_args()
    if training_device().type == "cpu":
        sys.exit("bench/speed/gpu.py: torch and Triton see no GPU here, so there is nothing to measure.")
    if options.present:
        return
    options.sizes, options.counts, options.rounds = SIZES, COUNTS, 20
    if options.quick:
        options.sizes, options.counts, options.rounds = SIZES[:1], COUNTS[:1], 5
    result = measure(options)
    deliver(options, "gpu", result, report(result))


if __name__ == "__main__":
    main()
