"""Losses for noisy mosaics of few views, by RawNeRF's measure: is noise worth knowing?

    python -m bench.peers.rawnerf_protocol [--quick] [--json] [--write] [--seeds 1] [--iterations 300]
        [--views 20,12,8,4] [--work FOLDER]

A phone at night (bench/support/phone_views.py), true poses, one exposure a view; six views are measured
against the clean mosaic (`recon.measure.protocols.rawnerf`). All rows of a scene have the same start, the
same number of Gaussians and the same iterations. Each seed has its own noise and order of training, and of
the tabletop its own poses. A Scaffold-like baseline is not among them: anchors whose Gaussians a network
decodes are a scene of another kind, of which nothing else here would remain. Finished rows are kept in
FOLDER.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.recon import inputs
from bench.recon.parts.noise_losses import (
    RelativeSquares,
    Residual,
    Stabilised,
    Whitened,
    coarse_to_fine,
    squares,
)
from bench.support.differences import paired, units
from bench.support.phone_views import LEVEL, NOISE, SCENES, PhoneViews, phone_views
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from recon.data.dataset import Dataset
from recon.data.light import Light, light_of, radiance_image
from recon.decide.presets import START_SHARE
from recon.measure.protocols.rawnerf import score
from recon.methods import nh_3dgs, vanilla
from recon.methods.method import Method
from recon.observe.linear import LinearLight
from recon.start.initialisation import gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.devices.warm_up import warm_up
from recon.train.schedule import rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training

CAP = 2000
STRENGTHS = 0.5, 1.0, 2.0
"""Parameters of non-local means, of which the best on the tested views is what a user would choose."""
Scores = list[dict[str, float]]
MEASURES = {"raw_psnr": ("RAW dB", 2), "rgb_psnr": ("RGB dB", 2), "rgb_ssim": ("RGB SSIM", 3)}


@dataclass(frozen=True)
class Row:
    """Training of a scene: its data, and their comparison."""

    name: str
    observation: Callable[[float], LinearLight]
    loss: Any = None
    given: Callable[[Dataset], Dataset] = inputs.brackets
    compose: Callable[[Dataset, Light], Method] = nh_3dgs.compose


ROWS = (
    Row("rig: mu-law, L1 and SSIM", LinearLight),
    Row("whitened, squares", Whitened, Residual(squares)),
    Row("whitened, squares at three scales", Whitened, Residual(coarse_to_fine)),
    Row("stabilised, L1 and SSIM", Stabilised),
    Row("RawNeRF: relative squares", RelativeSquares, Residual(squares)),
    Row("3DGS, demosaicked, mu-law", LinearLight, given=inputs.demosaicked, compose=vanilla.compose),
    *(
        Row(
            f"enhanced first: 3DGS, demosaicked, denoised by {strength:g} sigma",
            LinearLight,
            given=partial(inputs.denoised, strength=strength),
            compose=vanilla.compose,
        )
        for strength in STRENGTHS
    ),
)


class Studio:
    """Views of a scene, and a number of them with a start; the last ones are kept for the next row."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options, self._scene, self._count = options, ("", -1), -1

    def run(self, scene: str, seed: int, count: int, row: Row) -> Scores:
        """Train once on that many views; measure the tested ones."""
        iterations, cap = self.options.iterations, self.options.cap
        if self._scene != (scene, seed):
            self._scene, self._count = (scene, seed), -1
            self._views = phone_views(self.options.work / "phone", scene, seed)
        if self._count != count:
            self._count, self._dataset = count, self._views.of(count)
            images = [radiance_image(view) for view in self._dataset.train]
            self._light = light_of(self._dataset, images)
            rng = np.random.default_rng([seed, 0x57A27])
            self._start = start_points(self._dataset, images, int(START_SHARE * cap), rng)
        method = _method(row, self._dataset, self._light)
        gaussians = gaussians_at(self._start, method.appearance, method.observation.units)
        training = Training.begin(method, self._light, gaussians, self._dataset.extent)
        factor = rate_factor(iterations)
        plan = Plan(iterations, DensityRules(cap), seed, log_every=iterations, rate_factor=factor)
        train(training, row.given(self._dataset), plan)
        return _measured(self._views, training)


def _method(row: Row, dataset: Dataset, light: Light) -> Method:
    method = replace(row.compose(dataset, light), observation=row.observation(light.normaliser))
    return method if row.loss is None else replace(method, loss=row.loss)


@torch.no_grad()
def _measured(views: PhoneViews, training: Training) -> Scores:
    scores = []
    sensor = views.dataset.train[0].sensor
    for camera, reference in zip(views.cameras, views.references, strict=True):
        image = training.renderer()(training.gaussians, camera, degree=training.method.degree(1.0)).image
        light = training.method.observation.radiance(image).numpy().astype(np.float64)
        scores.append(score(light @ sensor.camera_from_rec709.T, reference))
    return scores


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"rawnerf-{options.iterations}-{options.cap}.jsonl")
    warm_up(lambda message, done, total: None)
    studio, rows = Studio(options), []
    for seed, scene in product(range(options.seeds), options.scenes):
        for count, row in product(options.views, ROWS):
            key = f"{scene} {seed} {count} {row.name}"
            if not cache.has(key):
                print(key, file=sys.stderr, flush=True)
            scores = cache.get(key, partial(studio.run, scene, seed, count, row))
            rows.append({"scene": scene, "seed": seed, "count": count, "row": row.name, "views": scores})
    return {
        "machine": machine(), "iterations": options.iterations, "cap": options.cap, "seeds": options.seeds,
        "scenes": options.scenes, "counts": options.views, "rows": rows,
    }  # fmt: skip


def report(result: dict[str, Any]) -> str:
    scenes = result["scenes"]
    lines = [
        "# RawNeRF's protocol: few and noisy views",
        "",
        f"`python -m bench.peers.rawnerf_protocol --write`: scenes {', '.join(scenes)}, "
        f"{result['seeds']} seeds each, 160 x 120 px, {result['iterations']} iterations, at most "
        f"{result['cap']:,} Gaussians. {words(result['machine'])}.",
        "",
        f"Variance of the signal (white at 1): {NOISE.slope:.3g} x + {NOISE.floor:.3g}, that of an iPhone X "
        "at ISO 2000; the median of green at 0.01. RAW: PSNR of the mosaic against the clean one; RGB: after "
        "an affine fit of each channel, as developed by multinerf. Means over scenes and seeds; in brackets "
        f"the row minus rig's own, +- standard error over {units(len(scenes), result['seeds'])}.",
        "",
        f"By its noise alone a photosite of the median is {_noise_psnr():.1f} dB from the truth; rows "
        "that lie far below that are limited by detail and geometry, not by noise.",
    ]
    for key, (title, digits) in MEASURES.items():
        counts = result["counts"]
        lines += ["", f"| {title} | {' | '.join(f'{count} views' for count in counts)} |"]
        lines.append("|---|" + "---|" * len(counts))
        for row in ROWS:
            cells = []
            for count in counts:
                of_row, first = (_of(result, name, count) for name in (row.name, ROWS[0].name))
                cell = f"{_mean(of_row, key):.{digits}f}"
                cells.append(
                    cell if row is ROWS[0] else f"{cell} ({paired(of_row, first, key).words(digits)})"
                )
            lines.append(f"| {row.name} | {' | '.join(cells)} |")
    lines += ["", "RAW dB by scene:", ""]
    lines.append(f"| | {' | '.join(f'{scene}, {count}' for scene in scenes for count in result['counts'])} |")
    lines.append("|---|" + "---|" * len(scenes) * len(result["counts"]))
    for row in ROWS:
        cells = [
            f"{_mean([one for one in _of(result, row.name, count) if one['scene'] == scene], 'raw_psnr'):.2f}"
            for scene in scenes
            for count in result["counts"]
        ]
        lines.append(f"| {row.name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _noise_psnr() -> float:
    return -10 * float(np.log10(NOISE.variance(np.array(LEVEL))))


def _of(result: dict[str, Any], name: str, count: int) -> list[dict[str, Any]]:
    return [one for one in result["rows"] if (one["row"], one["count"]) == (name, count)]


def _mean(rows: list[dict[str, Any]], key: str) -> float:
    return float(np.mean([view[key] for row in rows for view in row["views"]]))


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--iterations", type=int, default=300)
    parser.add_argument(
        "--views", type=lambda text: [int(part) for part in text.split(",")], default=[20, 12, 8, 4]
    )
    parser.add_argument("--scenes", type=lambda text: text.split(","), default=list(SCENES))
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.cap = CAP
    if options.quick:
        options.scenes, options.seeds, options.iterations, options.views = ["tabletop"], 1, 60, [4]
    result = measure(options)
    deliver(options, "rawnerf_protocol", result, report(result))


if __name__ == "__main__":
    main()
