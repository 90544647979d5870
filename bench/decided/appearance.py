"""Gain by the appearance of NH-3DGS: the same mosaics, loss, budget and start, another way to colour.

    python -m bench.decided.appearance [--quick] [--json] [--write] [--seeds 3] [--iterations 2000]
                               [--calibration own|truth] [--work FOLDER]

Every seed is another rig (lenses, colours, noise) of the demo and another order of training. Learning
rates of every row were searched on seed 0 at 600 iterations, over factors of four, for 3DGS over more;
`usual` is the exception: 3DGS with the rates of its paper. Differences are paired, their errors those of
rigs. Finished rows are kept in FOLDER; --write puts the table into bench/results/appearance.md.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from bench.decided.colours import LogRadiance, SoftplusRadiance
from bench.support.differences import kept, paired, units
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache, prepare, run, session
from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.methods import nh_3dgs, vanilla
from recon.methods.method import Method
from recon.scene.appearance import Appearance, PlainHarmonics, Rate

CAP = 20_000
MEASURES = {
    "hdr_psnr_mu_aligned": "dB",
    "hdr_psnr_mu_dark": "dB",
    "stops_median": "stops",
    "raw_psnr": "dB",
}


def with_appearance(appearance: Appearance) -> Callable[[Dataset, Light], Method]:
    """NH-3DGS with other colours."""
    return lambda dataset, light: replace(nh_3dgs.compose(dataset, light), appearance=appearance)


ROWS: dict[str, Callable[[Dataset, Light], Method]] = {
    "NH-3DGS (luminance-chromaticity)": nh_3dgs.compose,
    "vanilla (SH of 3DGS, tuned rates)": vanilla.compose,
    "SH of 3DGS, usual rates": with_appearance(
        PlainHarmonics(dc_rate=Rate(2.5e-3, 2.5e-3), rest_rate=Rate(1.25e-4, 1.25e-4))
    ),
    "softplus of SH, tuned": with_appearance(SoftplusRadiance()),
    "exp of SH, tuned": with_appearance(LogRadiance()),
}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"appearance-{options.calibration}-{options.iterations}-{options.sim}.jsonl")
    result: dict[str, Any] = {
        "machine": machine(),
        "iterations": options.iterations,
        "calibration": options.calibration,
        "seeds": list(range(options.seeds)),
        "rows": {name: [] for name in ROWS},
    }
    for seed in range(options.seeds):
        trial = None
        for name, compose in ROWS.items():

            def train(compose: Any = compose, seed: int = seed) -> Any:
                nonlocal trial
                folder = session(options.work, options.sim, seed, options.calibration)
                trial = trial or prepare(folder, options.cap, seed)
                return run(trial, compose, options.iterations, seed)[-1]

            found = cache.get(f"{seed} {name}", train)
            result["rows"][name].append(found | {"scene": options.sim, "seed": seed})
    return result


def report(result: dict[str, Any]) -> str:
    lines = [
        "# What the appearance buys",
        "",
        f"`python -m bench.decided.appearance --write`: the demo rig, seeds {result['seeds']}, "
        f"{result['iterations']} iterations, calibration: {result['calibration']}. "
        f"{words(result['machine'])}.",
        "",
        "Means over held-out views and seeds; in brackets NH-3DGS minus the row, +- standard error over",
        f"{units(1, len(result['seeds']))}: of other scenes they say nothing.",
        "",
        "| appearance | dB | dB, dark | stops | RAW dB | processor s |",
        "|---|---|---|---|---|---|",
    ]
    first = next(iter(result["rows"].values()))
    for name, rows in result["rows"].items():
        cells = []
        for key in MEASURES:
            digits = 3 if key == "stops_median" else 2
            cell = f"{sum(row[key] for row in rows) / len(rows):.{digits}f}"
            if rows is not first:
                cell += f" ({paired(first, rows, key).words(digits)})"
            cells.append(cell)
        used = sum(row["processor_seconds"] for row in rows) / len(rows)
        lines.append(f"| {name} | {' | '.join(cells)} | {used:.0f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--iterations", type=int, default=2000)
    parser.add_argument("--calibration", choices=("own", "truth"), default="own")
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.sim, options.cap = "demo", CAP
    if options.quick:
        options.sim, options.cap, options.seeds, options.iterations = "toy", 900, 1, 150
        options.calibration = "truth"
    result = measure(options)
    deliver(options, "appearance", result, report(result), kept(result["rows"], list(MEASURES)))


if __name__ == "__main__":
    main()
