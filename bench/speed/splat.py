"""Speed of the CPU rasteriser, against the same algorithm in plain torch, in one run.

    python -m bench.speed.splat [--quick] [--json] [--write] [--threads N] [--seed 0]

Times are wall-clock, the least of several runs (the machine may be shared); beside them the processor time
of our process. --quick leaves out the scaling from 1,000 to 1,000,000 Gaussians. --write puts the tables
into bench/results/splat.md and the first into docs/figures.md.
"""

import resource
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from torch.autograd import backward

from bench.speed import peers
from bench.speed.drawn import drawn
from bench.support.record import arguments, deliver, machine, words
from imaging.compute import threads
from imaging.files import store
from recon.splat import Limits, Render
from recon.splat.cpu import rasterizer
from recon.stability.workloads import view, workload
from recon.train.devices.warm_up import warm_up

BEGIN, END = "<!-- bench:splat -->", "<!-- /bench -->"
CUTS = {
    "3DGS: alpha 1/255, T 1e-4": Limits.gsplat(),
    "alpha 1/255, T 1e-8 (default)": Limits(),
    "luminance-aware over 2^20": Limits.for_scene(2.0**-20, 1.0),
    "alpha 1e-6, T 1e-8": Limits(alpha_min=1e-6),
}


def least(run: Callable[[], Any], seconds: float) -> tuple[float, float]:
    """Least wall-clock and processor time of a call, ms, repeated for `seconds` and at least 3 times."""
    wall, used, end, count = [], [], time.perf_counter() + seconds, 0
    while count < 3 or time.perf_counter() < end:
        count += 1
        start, clock = time.perf_counter(), time.process_time()
        run()
        wall.append(time.perf_counter() - start)
        used.append(time.process_time() - clock)
    return 1e3 * min(wall), 1e3 * min(used)


def ours(name: str, count: int, width: int, height: int, limits: Limits, seed: int, seconds: float) -> Any:
    """Forward, and forward with backward, of one workload."""
    tensors, camera = workload(name, count, seed), view(name, width, height)
    pull = torch.randn(height, width, 3, generator=torch.Generator().manual_seed(seed))
    last: list[Render] = []

    def forward() -> None:
        with torch.no_grad():
            last[:] = [drawn(tensors, camera, limits)]

    def both() -> None:
        for tensor in tensors:
            tensor.grad = None
        backward(drawn(tensors, camera, limits).image, pull)

    forward_ms, _ = least(forward, seconds / 2)
    both_ms, used = least(both, seconds)
    render = last[0]
    return {
        "workload": name,
        "gaussians": count,
        "size": f"{width}x{height}",
        "visible": render.visible,
        "pairs_per_pixel": round(render.pairs / (width * height), 1),
        "forward_ms": round(forward_ms, 2),
        "both_ms": round(both_ms, 2),
        "both_processor_ms": round(used, 2),
        "ns_per_pair": round(1e6 * both_ms / render.pairs, 2),
    }


def peer(count: int, width: int, height: int, seed: int, rounds: int) -> Any:
    """The torch tile loop on the same workload, with the thread count that suits it better."""
    tensors, camera = workload("object", count, seed), view("object", width, height)
    pull = torch.randn(height, width, 3, generator=torch.Generator().manual_seed(seed))
    lists = peers.tile_lists(tensors, camera)
    image = drawn(tensors, camera, Limits.gsplat()).image.detach()
    best, difference, before = (float("inf"), 0.0, 0), 0.0, torch.get_num_threads()
    for count_threads in sorted({1, before}):
        torch.set_num_threads(count_threads)
        for _ in range(rounds):
            start = time.perf_counter()
            theirs = peers.torch_tiles(tensors, camera, lists)
            middle = time.perf_counter()
            backward(theirs, pull)
            end = time.perf_counter()
            best = min(best, (1e3 * (end - start), 1e3 * (middle - start), count_threads))
            difference = float((theirs.detach() - image).abs().mean())
    torch.set_num_threads(before)
    both, forward, used = best
    return {
        "forward_ms": round(forward, 1),
        "both_ms": round(both, 1),
        "torch_threads": used,
        "mean_difference": difference,
    }


def kernels(count: int, width: int, height: int, seed: int, rounds: int) -> Any:
    """Least milliseconds of every kernel of a forward and backward pass, and pairs per second in two."""
    tensors, camera = workload("object", count, seed), view("object", width, height)
    pull = torch.randn(height, width, 3, generator=torch.Generator().manual_seed(seed))
    share, times = threads.share, defaultdict(list)

    def timed(kernel: Any, *arguments: Any) -> None:
        start = time.perf_counter()
        share(kernel, *arguments)
        times[kernel.__name__].append(1e3 * (time.perf_counter() - start))

    with patch.object(rasterizer, "share", timed):
        for _ in range(rounds):
            render = drawn(tensors, camera, Limits.gsplat())
            backward(render.image, pull)
    fastest = {name: min(spent) for name, spent in times.items()}
    return {
        "ms": {name: round(spent, 2) for name, spent in fastest.items()},
        "forward_pairs_per_s": round(render.pairs / fastest["composite"] / 1e6, 2),
        "backward_pairs_per_s": round(render.pairs / fastest["composite_backward"] / 1e6, 2),
    }


def _peak_mb() -> int:
    """Most memory that this process ever had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def measure(quick: bool, seed: int) -> dict[str, Any]:
    seconds = 1.0 if quick else 4.0
    result: dict[str, Any] = {"machine": machine(), "seed": seed, "quick": quick}
    started = time.perf_counter()
    warm_up(lambda message, done, total: None)
    result["warm_up_s"] = round(time.perf_counter() - started, 2)
    gsplat, before = Limits.gsplat(), _peak_mb()
    if not quick:
        result["scaling"] = []  # first, from few to many: the peak of the process is then that of the row
        for count in (1_000, 10_000, 100_000, 1_000_000):
            row = ours("object", count, 640, 480, gsplat, seed, seconds)
            result["scaling"].append(row | {"added_mb": _peak_mb() - before})
    sizes = [(10_000, 320, 240), (50_000, 640, 480), (200_000, 960, 720)]
    result["ours"] = [
        ours(name, *size, gsplat, seed, seconds) for name in ("object", "room") for size in sizes
    ]
    result["peer"] = peer(50_000, 640, 480, seed, 1 if quick else 3)
    mine = next(row for row in result["ours"] if row["gaussians"] == 50_000)
    result["times_faster"] = round(result["peer"]["both_ms"] / mine["both_ms"], 1)
    result["cuts"] = {
        label: ours("object", 50_000, 640, 480, limits, seed, seconds) for label, limits in CUTS.items()
    }
    result["kernels"] = kernels(50_000, 640, 480, seed, 20 if quick else 80)
    return result


def headline(result: dict[str, Any]) -> str:
    """The table of docs/figures.md."""
    mine = next(row for row in result["ours"] if row["gaussians"] == 50_000)
    peer_ms, m = result["peer"], result["machine"]
    return "\n".join(
        [
            "| | forward, ms | forward + backward, ms |",
            "|---|---|---|",
            f"| `recon.splat`, {m['threads']} threads | {mine['forward_ms']} | {mine['both_ms']} |",
            f"| plain torch, loop over tiles | {peer_ms['forward_ms']} | {peer_ms['both_ms']} |",
            "",
            f"{result['times_faster']} times faster. {words(m)}, seed {result['seed']}.",
        ]
    )


def report(result: dict[str, Any]) -> str:
    """All tables, in Markdown."""
    text = [
        "# The CPU rasteriser",
        "",
        "Generated by `python -m bench.speed.splat --write`. Times are the least of several runs.",
        "",
        "## 50,000 Gaussians at 640x480 (`object`), cut-offs of 3DGS",
        "",
        headline(result),
        "",
        f"Mean difference of the two images: {result['peer']['mean_difference']:.1e}. The peer's tile lists "
        "are made by our kernels outside its timing; torch had the thread count that suits it better: "
        f"{result['peer']['torch_threads']}.",
        "",
        "## Workloads, cut-offs of 3DGS",
        "",
    ]
    columns = ["workload", "gaussians", "size", "visible", "pairs_per_pixel", "forward_ms", "both_ms"]
    columns += ["both_processor_ms", "ns_per_pair"]
    text += _table(result["ours"], columns)
    text += ["", "## Cut-offs (50,000 Gaussians, 640x480, `object`)", ""]
    cut_rows = [{"cut_off": label, **row} for label, row in result["cuts"].items()]
    text += _table(cut_rows, ["cut_off", "pairs_per_pixel", "forward_ms", "both_ms"])
    text += ["", "## Kernels (50,000 Gaussians, 640x480, `object`, cut-offs of 3DGS; least of each), ms", ""]
    text += _table([result["kernels"]["ms"]], list(result["kernels"]["ms"]))
    text += [
        "",
        f"Evaluated pairs per second: {result['kernels']['forward_pairs_per_s']} G in `composite`, "
        f"{result['kernels']['backward_pairs_per_s']} G in `composite_backward`.",
    ]
    if "scaling" in result:
        text += ["", "## Scaling (`object`, 640x480)", ""]
        text += _table(
            result["scaling"],
            ["gaussians", "pairs_per_pixel", "forward_ms", "both_ms", "ns_per_pair", "added_mb"],
        )
    return "\n".join(text) + "\n"


def _table(rows: list[dict[str, Any]], columns: list[str]) -> list[str]:
    head = ["| " + " | ".join(c.replace("_", " ") for c in columns) + " |", "|" + "---|" * len(columns)]
    return head + ["| " + " | ".join(str(row[c]) for c in columns) + " |" for row in rows]


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.threads:
        threads.set_threads(options.threads)
        torch.set_num_threads(options.threads)
    result = measure(options.quick, options.seed)
    deliver(options, "splat", result, report(result))
    if options.write:
        page = Path(__file__).parents[2] / "docs" / "figures.md"
        text = page.read_text()
        if BEGIN in text:
            before, rest = text.split(BEGIN, 1)
            after = rest.split(END, 1)[1]
            store.write_bytes(page, f"{before}{BEGIN}\n{headline(result)}\n{END}{after}".encode())


if __name__ == "__main__":
    main()
