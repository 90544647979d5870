"""Backdrops of trainings of few real views: what light from far away gains, fine or coarse, trained or not.

    python -m bench.real.backdrop [--quick] [--json] [--write] [--work FOLDER] [--sets ...]

Sets and folds are those of `bench.real.more_time`; every training has harmonics of degree 0 and no
corrections, and is a draft, or for LONG and HALF a training of the preset standard. A map has the light of
far directions that views agree on (`recon.start.far_light`), of many rows or few, trained or fixed as that
is. CANDIDATES says which sets and folds each is tried on. Finished rows are kept in FOLDER.
--quick: the castle.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.peers.compare import session_of
from bench.peers.peer_folder import picture_of
from bench.real.more_time import KINDS, SETS, WIDTH, confirmed, figures, fold_of
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.arrays import Array
from recon.data.dataset import Dataset
from recon.data.light import Images, Light, light_of, radiance_images
from recon.data.load import load
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, START_SHARE, Quality, QualityName
from recon.decide.steps.method_choice import method_for
from recon.methods import METHODS
from recon.methods.method import Method
from recon.scene.appearance import Rate
from recon.scene.environment import NAME, RATE, Environment
from recon.scene.gaussians import Gaussians
from recon.start.far_light import FINEST, far_light, without_far
from recon.start.initialisation import Start, gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.schedule import rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training

PRESETS: tuple[QualityName, ...] = ("draft", "standard")
COARSE = 24
"""Rows of a coarse map: 7.5 degrees."""
TENTH, FIXED = Rate(0.003, 0.0003), Rate(1e-9, 1e-9)
"""Learning rates of ln radiance: a tenth of the usual, and one that moves no map by anything that shows."""
ALL = tuple((name, fold) for name in SETS for fold in range(4))
CASTLE = tuple(run for run in ALL if run[0] == "castle")
SOME = (*CASTLE[:2], ("brighton", 0), ("brighton", 1))
HALF = tuple(run for run in ALL if run[1] < 2)
"""Folds of the preset standard, of which only the usual training and the fixed map are made."""
LONG = ("usual", "coarse map, fixed")


@dataclass(frozen=True)
class Given:
    """Views of a fold, and where every training of it starts."""

    dataset: Dataset
    images: Images
    light: Light
    method: Method
    start: Start
    quality: Quality

    @property
    def cap(self) -> int:
        """Most Gaussians."""
        return self.quality.gaussians_of(len(self.dataset.train))

    def at(self, start: Start) -> Gaussians:
        """Gaussians at points."""
        return gaussians_at(start, self.method.appearance, self.method.observation.units)

    def map_of(self, rows: int) -> Environment:
        """Light of far directions as it is found."""
        return far_light(self.dataset.train, self.images, self.method.observation.units, rows)


Begun = tuple[Gaussians, Environment | None, Rate]
Candidate = Callable[[Given], Begun]


def usual(given: Given) -> Begun:
    """Begin as a draft without a far field."""
    return given.at(given.start), None, RATE


def fine(given: Given) -> Begun:
    """Begin with a far field of the photographs' pixels, without the points that they look through."""
    far, (views, images) = given.map_of(FINEST), (given.dataset.train, given.images)
    start = without_far(given.start, views, images, far, given.method.observation.units)
    return given.at(start), far, RATE


def coarse(rate: Rate) -> Candidate:
    """A coarse map behind all points, trained at a rate."""
    return lambda given: (given.at(given.start), given.map_of(COARSE), rate)


CANDIDATES: dict[str, tuple[Candidate, tuple[tuple[str, int], ...]]] = {
    "fine map, trained": (fine, CASTLE[:2]),
    "coarse map, trained": (
        coarse(RATE),
        (*CASTLE, *SOME[2:], ("monstree", 0), ("monstree", 1), ("banana", 0)),
    ),
    "coarse map, at a tenth": (
        coarse(TENTH),
        (CASTLE[0], CASTLE[1], CASTLE[3]),
    ),
    "coarse map, fixed": (coarse(FIXED), ALL),
}


@cache
def given(session: Path, quality: QualityName) -> Given:
    """Read a fold and sweep it."""
    preset = QUALITIES[quality]
    dataset = load(session, max_width=WIDTH)
    images = [(np.array(image), np.array(trusted)) for image, trusted in radiance_images(dataset)]
    light = light_of(dataset, images)
    half = int(START_SHARE * preset.gaussians_of(len(dataset.train)))
    rng = np.random.Generator(np.random.PCG64([0, 0x57A27]))
    start = start_points(dataset, images, half, rng, light=light)
    method = Overrides(degree=0).composed(METHODS[method_for(dataset, "auto")[0]](dataset, light))
    return Given(dataset, images, light, method, start, preset)


def begun(given: Given, candidate: Candidate) -> Training:
    """A training that starts as a candidate has it."""
    gaussians, far, rate = candidate(given)
    training = Training.begin(given.method, given.light, gaussians, given.dataset.extent, environment=far)
    for group in training.optimizer.param_groups:
        if group["name"] == NAME:
            group["rate"] = rate
    return training


def trained(session: Path, whole: Path, candidate: Candidate, quality: QualityName) -> dict[str, Any]:
    """Figures by held-out view of one training; whole: the session of all views, which confirms pixels."""
    here = given(session, quality)
    training = begun(here, candidate)
    iterations = here.quality.iterations_of(len(here.dataset.train))
    plan = Plan(iterations, DensityRules(here.cap), rate_factor=rate_factor(iterations))
    train(training, here.dataset, plan)
    renderer, masks, views = training.renderer(), confirmed(whole), {}
    for view in here.dataset.held_out:
        (shot,) = view.shots
        with torch.no_grad():
            image = renderer(training.gaussians, view.lens, degree=0).image
            image = here.method.observation.predict(image, view, shot.k).double()
        mask = masks.get(str(view.id), np.zeros_like(view.valid))
        views[str(view.id)] = figures(view, picture_of(view), image.numpy(), mask)
    return {"views": views}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each candidate, set and fold, beside the usual training of the same."""
    cache, rows = Cache(options.work / "real-backdrop.jsonl"), []
    sets = SETS[:1] if options.quick else options.sets
    for name, (candidate, runs) in {"usual": (usual, ALL), **CANDIDATES}.items():
        planned: list[tuple[QualityName, str, int]] = [("draft", *run) for run in runs]
        planned += [("standard", *run) for run in HALF if name in LONG]
        for quality, known, fold in (run for run in planned if run[1] in sets):

            def made(
                quality: QualityName = quality,
                known: str = known,
                fold: int = fold,
                candidate: Candidate = candidate,
            ) -> dict[str, Any]:
                whole = session_of(known, options.work)
                return trained(fold_of(whole, fold, options.work), whole, candidate, quality)

            key = f"{name} {known} {fold}" + ("" if quality == "draft" else f" {quality}")
            row = {"candidate": name, "quality": quality, "set": known, "fold": fold}
            rows.append(row | cache.get(key, made))
    return {"machine": machine(), "rows": rows}


def gains(result: dict[str, Any], quality: QualityName, candidate: str, name: str) -> Array:
    """Difference to the usual trainings of the same folds, [views, (dB, confirmed, others, SSIM)]."""
    of = {
        (row["candidate"], row["set"], row["fold"]): row["views"]
        for row in result["rows"]
        if row["quality"] == quality
    }
    return np.array(
        [
            [views[view][kind] - of["usual", name, fold][view][kind] for kind in KINDS]
            for (tried, known, fold), views in of.items()
            if (tried, known) == (candidate, name)
            for view in views
        ]
    ).reshape(-1, len(KINDS))


def report(result: dict[str, Any]) -> str:
    """The table of what each candidate adds to each set."""
    lines = [
        "# Backdrops of few real photographs",
        "",
        f"`python -m bench.real.backdrop --write`: {WIDTH} px, one seed, iterations and Gaussians of the "
        f"preset. {words(result['machine'])}.",
        "",
        f"Maps of light from far away: fine has the photographs' pixels, coarse {COARSE} rows; trained at "
        "the usual rate, at a tenth of it, or fixed as views agree on it. Added to a training without a far "
        "field, held-out dB after a gain a channel, over the views of the folds tried: of all pixels, of "
        "those whose depth another photograph confirms, and of the others; SSIM. Behind +-: the standard "
        "error over views.",
        "",
        "| preset | candidate | set | views | dB | confirmed | others | SSIM | views that lose |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for quality, candidate in product(PRESETS, CANDIDATES):
        for name in SETS:
            gain = gains(result, quality, candidate, name)
            if not len(gain):
                continue
            error = np.nanstd(gain, axis=0, ddof=1) / np.sqrt(np.isfinite(gain).sum(axis=0))
            cells = [
                f"{m:+.{places}f} +- {e:.{places}f}"
                for m, e, places in zip(np.nanmean(gain, axis=0), error, (2, 2, 2, 3), strict=True)
            ]
            titles, losing = f"{quality} | {candidate} | {name}", (gain[:, 0] < 0).sum()
            lines.append(f"| {titles} | {len(gain)} | {' | '.join(cells)} | {losing} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--sets", nargs="+", default=SETS)
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "real_backdrop", result, report(result))


if __name__ == "__main__":
    main()
