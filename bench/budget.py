"""What time buys: quality of the demo against iterations and Gaussians, the curve behind the presets.

    python bench/budget.py [--quick] [--json] [--write] [--seed 0] [--calibration own|truth] [--work FOLDER]

Each row is a whole training with its own schedule, not a point on the way of a longer one. Seconds are
wall-clock of the training loop on this machine, processor seconds all its threads together.
"""

import argparse
from pathlib import Path
from typing import Any

from record import WORK, arguments, deliver, machine, words
from trial import Cache, prepare, run, session

from recon.methods import nh_3dgs

GRID = [(250, 10_000), (500, 10_000), (500, 20_000), (1000, 20_000), (2000, 20_000), (4000, 20_000)]
GRID += [(1000, 40_000), (2000, 40_000), (4000, 40_000)]
COLUMNS = ("iterations", "gaussians", "seconds", "processor_seconds")
MEASURES = ("hdr_psnr_mu_aligned", "hdr_psnr_mu_dark", "stops_median", "raw_psnr")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"budget-{options.calibration}-{options.sim}-{options.seed}.jsonl")
    rows = []
    for iterations, cap in options.grid:

        def train(iterations: int = iterations, cap: int = cap) -> Any:
            folder = session(options.work, options.sim, options.seed, options.calibration)
            return run(prepare(folder, cap, options.seed), nh_3dgs.compose, iterations, options.seed)[-1]

        rows.append(cache.get(f"{iterations} {cap}", train))
    return {
        "machine": machine(),
        "calibration": options.calibration,
        "seed": options.seed,
        "rows": rows,
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# What time buys",
        "",
        f"`python bench/budget.py --write`: the demo rig, seed {result['seed']}, NH-3DGS, calibration: "
        f"{result['calibration']}. {words(result['machine'])}.",
        "",
        "| iterations | Gaussians | s | processor s | dB | dB, dark | stops | RAW dB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        cells = [f"{row[key]:.0f}" for key in COLUMNS]
        cells += [f"{row[key]:.{3 if key == 'stops_median' else 2}f}" for key in MEASURES]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--calibration", choices=("own", "truth"), default="own")
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.sim, options.grid = "demo", GRID
    if options.quick:
        options.sim, options.calibration = "toy", "truth"
        options.grid = [(50, 600), (100, 600), (200, 600), (200, 1200)]
    result = measure(options)
    deliver(options, "budget", result, report(result))


if __name__ == "__main__":
    main()
