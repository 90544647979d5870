"""Cost and gain of each choice that NH-3DGS leaves open: one is changed at a time.

    python -m bench.decided.ablation [--quick] [--json] [--write] [--seeds 2] [--iterations 1000] [--work
    FOLDER]

All rows but those of another mu have the mu of the papers. The demo and the gallery, RAW brackets, the
calibration taken from the truth, so that nothing but the choice differs; each seed is another rig and another
order of training. Differences are paired, their errors those of scenes and rigs. Finished rows are kept in
FOLDER.
"""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from bench.decided.growth import contribution, mcmc
from bench.decided.variants import ClampedChroma, LogBlended, LogBlending, ThirdDegree
from bench.support.differences import kept, paired, units
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache, Trial, prepare, run, session
from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.methods import nh_3dgs
from recon.methods.method import Method
from recon.observe.linear import LinearLight
from recon.observe.losses import Photometric
from recon.train.densification import DensityRules

CAP = 20_000
PAPERS_MU = 5000.0
BASE = "as it is, but with the papers' mu of 5000"
MEASURES = {"hdr_psnr_mu_aligned": 2, "hdr_psnr_mu_dark": 2, "stops_median": 4, "raw_psnr": 2}
TITLES = ("dB", "dB, dark", "stops", "RAW dB", "Gaussians", "processor s")
Compose = Callable[[Dataset, Light], Method]


@dataclass(frozen=True)
class Row:
    """A method, and what else is different while it trains."""

    compose: Compose = nh_3dgs.compose
    within: Callable[[], Any] = nullcontext
    start: float = 0.5
    """Share of the Gaussians at the beginning."""


def changed(**fields: Any) -> Compose:
    """NH-3DGS with other parts."""
    return lambda dataset, light: replace(nh_3dgs.compose(dataset, light), **fields)


def log_blended(dataset: Dataset, light: Light) -> Method:
    """Blends logarithms of radiance."""
    method = nh_3dgs.compose(dataset, light)
    floor = light.reference or 2.0**-20
    assert isinstance(method.observation, LinearLight)
    observation = LogBlending(light.normaliser, floor=floor)
    return replace(method, appearance=LogBlended(method.appearance, floor), observation=observation)


def scene_mu_law(dataset: Dataset, light: Light) -> Method:
    """One mu-law for all exposures, over the scene's maximum, as the paper has it for merged HDR."""
    return replace(nh_3dgs.compose(dataset, light), observation=LinearLight(light.normaliser, "scene"))


@contextmanager
def mu(value: float) -> Iterator[None]:
    """Another mu in the loss; that of the metrics stays."""
    with mock.patch("recon.observe.linear.SIGNAL_MU", value):
        yield


@contextmanager
def rules(**fields: Any) -> Iterator[None]:
    """Other constants of growth and pruning."""
    with mock.patch("bench.support.trial.DensityRules", lambda cap: replace(DensityRules(cap), **fields)):
        yield


ROWS: dict[str, Row] = {
    BASE: Row(),
    "SSIM weight 0": Row(changed(loss=Photometric(0.0))),
    "SSIM weight 0.2 (3DGS)": Row(changed(loss=Photometric(0.2))),
    "SSIM weight 0.8 (the paper)": Row(changed(loss=Photometric(0.8))),
    "mu 150": Row(within=lambda: mu(150.0)),
    "mu 500 (as it is)": Row(within=lambda: mu(500.0)),
    "mu 50000": Row(within=lambda: mu(50000.0)),
    "mu-law over the scene instead of the exposure": Row(scene_mu_law),
    "blending of logarithms": Row(log_blended),
    "chroma clamped instead of through a sigmoid": Row(changed(appearance=ClampedChroma())),
    "harmonics of degree 0": Row(changed(degrees=())),
    "harmonics of degree 1": Row(changed(degrees=(0.3,))),
    "harmonics of degree 3": Row(changed(appearance=ThirdDegree(), degrees=(0.3, 0.5, 0.7))),
    "no growth": Row(within=lambda: rules(growth=0.0), start=1.0),
    "pruning by contribution": Row(within=contribution),
    "growth by MCMC": Row(within=mcmc),
    "growth by MCMC, opacity pulled by 0.01": Row(changed(opacity_weight=0.01), mcmc),
    "opacity pulled to 0 by 0.01": Row(changed(opacity_weight=0.01)),
}


@dataclass
class Studio:
    """The starts of a session, by how many Gaussians they have."""

    options: argparse.Namespace
    name: str = ""
    trials: dict[float, Trial] = field(default_factory=dict)

    def trial(self, scene: str, seed: int, start: float) -> Trial:
        """Made once for as long as the session is the same."""
        if self.name != f"{scene} {seed}":
            self.name, self.trials = f"{scene} {seed}", {}
        if start not in self.trials:
            folder = session(self.options.work, scene, seed, "truth")
            with mock.patch("bench.support.trial.START_SHARE", start):
                self.trials[start] = prepare(folder, self.options.cap, seed)
        return self.trials[start]


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, studio = (
        Cache(options.work / f"ablation-{options.iterations}-{options.cap}.jsonl"),
        Studio(options),
    )
    rows: dict[str, list[Any]] = {name: [] for name in ROWS}
    for scene in options.scenes:
        for seed in range(options.seeds):
            for name, row in ROWS.items():

                def train(scene: str = scene, seed: int = seed, row: Row = row) -> Any:
                    trial = studio.trial(scene, seed, row.start)
                    with mu(PAPERS_MU), row.within():
                        return run(trial, row.compose, options.iterations, seed)[-1]

                found = cache.get(f"{scene} {seed} {name}", train)
                rows[name].append(found | {"scene": scene, "seed": seed})
    return {
        "machine": machine(),
        "iterations": options.iterations,
        "seeds": options.seeds,
        "scenes": options.scenes,
        "rows": rows,
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# One choice changed at a time",
        "",
        "`python -m bench.decided.ablation --write`: NH-3DGS on RAW brackets, scenes "
        f"{', '.join(result['scenes'])}, "
        f"{result['seeds']} seeds each, {result['iterations']} iterations. {words(result['machine'])}.",
        "",
        "Means over held-out views, seeds and scenes; in brackets the row minus the first, +- standard error",
        f"over {units(len(result['scenes']), result['seeds'])}.",
        "",
        f"| changed | {' | '.join(TITLES)} |",
        "|---|" + "---|" * len(TITLES),
    ]
    for number, (name, rows) in enumerate(result["rows"].items()):
        cells = [name]
        for key, digits in MEASURES.items():
            cell = f"{np.mean([row[key] for row in rows]):.{digits}f}"
            if number:
                cell += f" ({paired(rows, result['rows'][BASE], key).words(digits)})"
            cells.append(cell)
        cells.append(f"{np.mean([row['gaussians'] for row in rows]):.0f}")
        cells.append(f"{np.mean([row['processor_seconds'] for row in rows]):.0f}")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--iterations", type=int, default=1000)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.scenes, options.cap = ("demo", "gallery"), CAP
    if options.quick:
        options.scenes, options.cap, options.seeds, options.iterations = ("toy",), 600, 1, 60
    result = measure(options)
    deliver(options, "ablation", result, report(result), kept(result["rows"], list(MEASURES)))


if __name__ == "__main__":
    main()
