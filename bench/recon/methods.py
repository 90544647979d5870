"""NH-3DGS on RAW brackets against 3DGS in several dresses, on what other programs would train on.

    python -m bench.recon.methods [--quick] [--json] [--write] [--seeds 3] [--iterations 1000]
                            [--calibration truth|own] [--work FOLDER]

Two scenes, each seed another rig (lenses, colours, sensors, noise) and another order of training; the start,
the number of Gaussians and the iterations are the same for all rows, and so is the mu of the loss: that of
the papers. EXR files are demosaicked as `rig merge` does it, along edges (imaging/demosaicking/); one row has
bilinear ones, to show what that is worth. Colour rates of every appearance are searched alike, for brackets
and for merged EXR: on seed 0 of the demo, a third, once and three times the rates that are below. "3DGS, as
published" has the rates and the weight of SSIM (0.2) of the paper, which are not searched; harmonics end at
degree 2 (3 in the paper), and all rows grow by rank and have no reset of opacity. Finished rows are kept in
FOLDER.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from torch import Tensor

from bench.recon import inputs
from bench.recon.parts.softplus_radiance import SoftplusRadiance
from bench.support.differences import paired, stored_rows, units
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache, Trial, prepare, run, session
from recon.data.dataset import Dataset, View
from recon.data.light import Light, light_of, radiance_image
from recon.methods.method import Method
from recon.observe.linear import LIGHT_MU, LinearLight
from recon.observe.losses.photometric import Photometric
from recon.scene.appearance import LuminanceChromaticity, PlainHarmonics, Rate

CAP = 20_000
PAPERS_MU = 5000.0
FACTORS = (1 / 3, 1.0, 3.0)
SEARCH = 500
"""Iterations of a trial of learning rates."""
MEASURES = {
    "hdr_psnr_mu_aligned": 2, "hdr_psnr_mu_dark": 2, "stops_median": 4,
    "raw_psnr": 2, "raw_psnr_shadows": 2, "raw_psnr_highlights": 2,
}  # fmt: skip
TITLES = ("dB", "dB, dark", "stops", "RAW dB", "RAW dB, shadows", "RAW dB, highlights", "processor s")

APPEARANCES: dict[str, LuminanceChromaticity | SoftplusRadiance | PlainHarmonics] = {
    "luminance-chromaticity": LuminanceChromaticity(),
    "softplus of SH": SoftplusRadiance(),
    "SH of 3DGS, tuned": PlainHarmonics(dc_rate=Rate(1e-4, 1e-5), rest_rate=Rate(5e-6, 5e-7)),
    "SH of 3DGS, usual rates": PlainHarmonics(),
    "3DGS, as published": PlainHarmonics(),
}
PUBLISHED, NOT_SEARCHED = "3DGS, as published", ("SH of 3DGS, usual rates", "3DGS, as published")
PUBLISHED_SSIM = 0.2


@dataclass
class LinearLoss(LinearLight):
    """Compares linear values of an EXR, over the brightest of the scene."""

    def compare(self, image: Tensor, view: View, *rest: Any) -> tuple[Tensor, Tensor]:
        """Linear planes, [3, H, W]."""
        target = torch.from_numpy(view.shots[0].pixels / np.float32(self.normaliser))
        return image.movedim(2, 0), target.movedim(2, 0)


@dataclass
class OneMuLaw(LinearLight):
    """Compares every shot in the units of the scene, divided by its own scale again: one mu-law for all."""

    def compression(self, view: View) -> tuple[list[float], float]:
        """The scale of each shot, and the mu of light."""
        return [self.normaliser * shot.k for shot in view.shots], LIGHT_MU


@dataclass(frozen=True)
class Row:
    """Row: data, appearance and comparison."""

    given: str
    appearance: str
    compared: Callable[[float], LinearLight] = LinearLight

    @property
    def name(self) -> str:
        """Label of its line."""
        return f"{self.given} | {self.appearance}"


INPUTS: dict[str, Callable[[Dataset], Dataset]] = {
    "RAW brackets": inputs.brackets,
    "demosaicked brackets": inputs.demosaicked,
    "merged mosaics": inputs.merged_mosaic,
    "merged EXR": inputs.merged,
    "merged EXR, linear loss": inputs.merged,
    "merged EXR, bilinear": partial(inputs.merged, picture=inputs.bilinear_image),
}
NH, TUNED = "luminance-chromaticity", "SH of 3DGS, tuned"
ROWS = (
    *(Row("RAW brackets", name) for name in APPEARANCES if name != PUBLISHED),
    Row("demosaicked brackets", NH),
    Row("merged mosaics", NH, OneMuLaw),
    *(Row("merged EXR", name, OneMuLaw) for name in APPEARANCES),
    Row("merged EXR, linear loss", PUBLISHED, LinearLoss),
    Row("merged EXR, bilinear", TUNED, OneMuLaw),
)


def composed(row: Row, factor: float) -> Callable[[Dataset, Light], Method]:
    """The method of a row, its colour rates times a factor."""
    appearance = APPEARANCES[row.appearance]
    rates: dict[str, Any] = {
        field.name: Rate(rate.start * factor, rate.end * factor)
        for field in fields(appearance)
        if isinstance(rate := getattr(appearance, field.name), Rate)
    }
    appearance = replace(appearance, **rates)
    loss = Photometric(ssim_weight=PUBLISHED_SSIM) if row.appearance == PUBLISHED else Photometric()
    return lambda dataset, light: Method(row.name, appearance, row.compared(light.normaliser), loss)


class Studio:
    """Sessions, each loaded and started once: points are those of the brackets, whatever is trained on."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options, self._name = options, ""

    def trial(self, scene: str, seed: int, given: str) -> Trial:
        """A session of a scene, seen as a kind of input."""
        if self._name != f"{scene} {seed}":
            self._name, self._lights = f"{scene} {seed}", dict[str, Light]()
            folder = session(self.options.work, scene, seed, self.options.calibration)
            self._whole = prepare(folder, self.options.cap, seed)
        dataset = INPUTS[given](self._whole.dataset)
        if given not in self._lights:
            self._lights[given] = light_of(dataset, [radiance_image(view) for view in dataset.train])
        return replace(self._whole, dataset=dataset, light=self._lights[given])


def searched(options: argparse.Namespace, cache: Cache, studio: Studio) -> dict[str, float]:
    """Factors on the colour rates of every row: the best of a search, by the truth of seed 0.

    Searched for brackets and for merged EXR; demosaicked brackets are compared as brackets are. The usual
    rates of 3DGS stay as they are.
    """
    best = {}
    for given, appearance in product(("RAW brackets", "merged EXR"), APPEARANCES):
        if appearance in NOT_SEARCHED or Row(given, appearance).name not in {row.name for row in ROWS}:
            continue
        row = next(row for row in ROWS if (row.given, row.appearance) == (given, appearance))
        scores = []
        for factor in options.factors:

            def train(row: Row = row, factor: float = factor) -> Any:
                trial = studio.trial(options.scenes[0], 0, row.given)
                return run(trial, composed(row, factor), options.search, 0)[-1]

            cached = cache.get(f"search {row.name} {factor:.3g}", train)
            scores.append(cached["hdr_psnr_mu_aligned"])
        best[given, appearance] = options.factors[int(np.argmax(scores))]
    return {
        row.name: best.get((("merged EXR" if "merged" in row.given else "RAW brackets"), row.appearance), 1.0)
        for row in ROWS
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"methods-{options.calibration}-{options.iterations}-{options.cap}.jsonl")
    studio = Studio(options)
    factors = searched(options, cache, studio)
    rows: dict[str, list[Any]] = {row.name: [] for row in ROWS}
    for seed in range(options.seeds):
        for scene in options.scenes:
            for row in ROWS:

                def train(scene: str = scene, seed: int = seed, row: Row = row) -> Any:
                    method = composed(row, factors[row.name])
                    return run(studio.trial(scene, seed, row.given), method, options.iterations, seed)[-1]

                key = f"{scene} {seed} {row.name} {factors[row.name]}"
                rows[row.name].append(cache.get(key, train) | {"scene": scene, "seed": seed})
    return {
        "machine": machine(),
        "iterations": options.iterations,
        "calibration": options.calibration,
        "seeds": options.seeds,
        "scenes": options.scenes,
        "factors": factors,
        "rows": rows,
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Methods",
        "",
        f"`python -m bench.recon.methods --write`: scenes {', '.join(result['scenes'])}, "
        f"{result['seeds']} seeds each, {result['iterations']} iterations, "
        f"calibration: {result['calibration']}. {words(result['machine'])}.",
        "",
        "Means over held-out views, seeds and scenes; in brackets the first row minus the row, +- standard",
        f"error over {units(len(result['scenes']), result['seeds'])}. Shadows: below 1 % of the scene's",
        "maximum, highlights: above 50 %, of unclipped photosites only. Rates: what the search multiplied",
        "the colour rates by.",
        "",
        f"| trained on | appearance | rates | {' | '.join(TITLES)} |",
        "|" + "---|" * (len(TITLES) + 3),
    ]
    first = result["rows"][ROWS[0].name]
    for row in ROWS:
        entries = result["rows"][row.name]
        cells = [row.given, row.appearance, f"{result['factors'][row.name]:.2g}"]
        for key, digits in MEASURES.items():
            cell = f"{np.nanmean([entry[key] for entry in entries]):.{digits}f}"
            if row is not ROWS[0]:
                cell += f" ({paired(first, entries, key).words(digits)})"
            cells.append(cell)
        cells.append(f"{np.mean([entry['processor_seconds'] for entry in entries]):.0f}")
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "By scene, dB:", "", f"| trained on | appearance | {' | '.join(result['scenes'])} |"]
    lines.append("|---|---|" + "---|" * len(result["scenes"]))
    for row in ROWS:
        entries = result["rows"][row.name]
        cells = [
            f"{np.mean([entry['hdr_psnr_mu_aligned'] for entry in entries if entry['scene'] == scene]):.2f}"
            for scene in result["scenes"]
        ]
        lines.append(f"| {row.given} | {row.appearance} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--iterations", type=int, default=1000)
    parser.add_argument("--calibration", choices=("own", "truth"), default="truth")
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.scenes, options.cap = ("demo", "gallery"), CAP
    options.search, options.factors = SEARCH, FACTORS
    if options.quick:
        options.scenes, options.cap, options.seeds, options.iterations = ("toy",), 600, 1, 60
        options.calibration, options.search, options.factors = "truth", 30, (1.0,)
    with mock.patch("recon.observe.linear.SIGNAL_MU", PAPERS_MU):
        result = measure(options)
    deliver(options, "methods", result, report(result), stored_rows(result["rows"], list(MEASURES)))


if __name__ == "__main__":
    main()
