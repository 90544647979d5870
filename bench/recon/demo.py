"""The figures of `rig demo`: held-out views against the simulator's light, in decibels and in stops.

    python -m bench.recon.demo [--quick] [--json] [--write] [--work FOLDER]

--work: where the demo is, or is made; a finished one is measured as it is. --quick: the same.
"""

import argparse
from pathlib import Path
from typing import Any

from bench.support.record import WORK, arguments, deliver, machine, words
from imaging.files import store
from rig.__main__ import main as run

COLUMNS = {
    "hdr_psnr_mu_p999": "mu-law over the 99.9th percentile, dB",
    "hdr_psnr_mu_aligned": "over the brightest, dB",
    "truth_p999": "99.9th percentile",
    "truth_peak": "brightest",
    "stops_median": "stops, median",
    "stops_dark": "darkest tenth",
    "stops_bright": "brightest hundredth",
    "width": "px",
    "iterations": "iterations",
    "gaussians": "Gaussians",
    "train_seconds": "s",
}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Make the demo unless it is there, and read its evaluation."""
    folder = options.work / "demo"
    if not (folder / "reconstructions" / "demo" / "metrics.json").is_file():
        assert run(["demo", str(folder)]) == 0
    metrics = store.read_json(folder / "reconstructions" / "demo" / "metrics.json")
    return {"machine": machine(), "figures": {key: metrics[key] for key in COLUMNS}}


def table(result: dict[str, Any]) -> str:
    """Markdown."""
    figures = [f"{value:.4g}" if value < 1000 else f"{value:.0f}" for value in result["figures"].values()]
    return "\n".join(
        [
            "# The demo",
            "",
            f"`python -m bench.recon.demo --write`. {words(result['machine'])}.",
            "",
            "Held-out views of the preset standard against the true radiance, at the best exposure.",
            "",
            f"| {' | '.join(COLUMNS.values())} |",
            "|" + "---|" * len(COLUMNS),
            f"| {' | '.join(figures)} |",
            "",
        ]
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "demo", result, table(result))


if __name__ == "__main__":
    main()
