"""Speed of drawing each method's model on the CPU, as a ratio to 3DGS: same Gaussians, same geometry.

    python -m bench.speed.render_speed [--quick] [--json] [--write] [--repeats 100] [--gaussians 20000]
                                 [--iterations 500] [--work FOLDER]

NH-3DGS is trained on the demo; its geometry is that of all rows, whose colours show what its Gaussians show.
3DGS has its harmonics, once with its own cut-offs, which let light leak, and once with those of HDR. HDR-GS
is drawn down to the codes of a photograph, through its curve. All draw a view one after another in one
process, in an order that changes, without gradient; then the next view. Ratios are medians over repeats of
the time over that of 3DGS next to it; frames a second are of the median time.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Trial, prepare, session
from imaging.session.calibration import Response
from recon.data.dataset import Dataset, View
from recon.methods import hdr_gs, nh_3dgs
from recon.scene.appearance import PlainHarmonics
from recon.scene.gaussians import GEOMETRY, Gaussians, Renderer, limits_for
from recon.scene.harmonics import C0, DEGREE
from recon.splat import Limits
from recon.splat.torch_threads import torch_on_one_thread
from recon.start.initialisation import gaussians_at
from recon.train.densification import DensityRules
from recon.train.devices.warm_up import warm_up
from recon.train.trainer import train
from recon.train.training import Plan, Training

FIRST = "vanilla 3DGS"
USUAL = Limits(alpha_max=0.99, t_min=1e-4, alpha_min=1 / 255)
"""The cut-offs of 3DGS (Kerbl et al., arXiv 2308.04079)."""


@dataclass(frozen=True)
class Drawn:
    """A model, and what else is done to a rendering of it until it is what the method shows."""

    renderer: Renderer
    gaussians: Gaussians
    finish: Callable[[torch.Tensor, View], torch.Tensor] = lambda image, view: image

    def seconds(self, view: View) -> float:
        """Time of one picture."""
        began = time.perf_counter()
        self.finish(self.renderer(self.gaussians, view.lens, degree=DEGREE).image, view)
        return time.perf_counter() - began


def grown(trial: Trial, iterations: int) -> Training:
    """NH-3DGS with as many Gaussians as there will be."""
    method = nh_3dgs.compose(trial.dataset, trial.light)
    gaussians = gaussians_at(trial.start, method.appearance, method.observation.units)
    training = Training.begin(method, trial.light, gaussians, trial.dataset.extent)
    plan = Plan(iterations, DensityRules(trial.cap), log_every=iterations)
    train(training, trial.dataset, plan)
    return training


def developed(dataset: Dataset) -> Dataset:
    """Treat its cameras as if they gave photographs."""
    response = Response(kind="srgb", evidence="of this script")

    def developed(view: View) -> View:
        return replace(view, sensor=replace(view.sensor, kind="ldr", cfa=None, response=response))

    return replace(
        dataset,
        train=tuple(map(developed, dataset.train)),
        held_out=tuple(map(developed, dataset.held_out)),
    )


def models(trial: Trial, training: Training) -> dict[str, Drawn]:
    """Models of every row."""
    light, gaussians = trial.light, training.gaussians
    wide = limits_for(light.reference)
    parameters = gaussians.parameters
    geometry = {name: parameters[name] for name in GEOMETRY}
    shown = parameters["ln_luminance"].exp()[:, None] * torch.sigmoid(C0 * parameters["chroma_dc"][:, 0])
    harmonics = PlainHarmonics()
    plain = Gaussians({**geometry, **harmonics.start(shown)})
    photographs = hdr_gs.compose(developed(trial.dataset), light)
    toned = Gaussians({**geometry, **{key: parameters[key] for key in photographs.appearance.rates}})
    k = trial.dataset.train[0].shots[0].k

    def codes(image: torch.Tensor, view: View) -> torch.Tensor:
        return photographs.observation.predict(image, view, k)

    return {
        FIRST: Drawn(Renderer(harmonics, USUAL), plain),
        "vanilla 3DGS, the cut-offs of HDR": Drawn(Renderer(harmonics, wide), plain),
        "NH-3DGS": Drawn(Renderer(training.method.appearance, wide), gaussians),
        "HDR-GS, with its curve": Drawn(Renderer(photographs.appearance, wide), toned, codes),
    }


def sized(view: View, width: int, height: int) -> View:
    """A view of as many pixels."""
    lens = view.lens
    across, down = width / lens.width, height / lens.height
    lens = replace(
        lens, width=width, height=height, fx=lens.fx * across, fy=lens.fy * down, cx=lens.cx * across,
        cy=lens.cy * down,
    )  # fmt: skip
    plain = np.ones((height, width), np.float32)
    return replace(view, lens=lens, sensor=replace(view.sensor, falloff=plain))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    warm_up(lambda message, done, total: None)
    trial = prepare(session(options.work, options.sim, 0, "truth"), options.gaussians, 0)
    training = grown(trial, options.iterations)
    drawn = models(trial, training)
    names, rows = list(drawn), []
    for width, height in options.sizes:
        views = [sized(view, width, height) for view in developed(trial.dataset).views]
        taken: dict[str, list[float]] = {name: [] for name in names}
        with torch_on_one_thread(), torch.no_grad():
            for repeat in range(-2, options.repeats):
                turn = repeat % len(names)
                for name in names[turn:] + names[:turn]:
                    seconds = drawn[name].seconds(views[repeat % len(views)])
                    if repeat >= 0:
                        taken[name].append(seconds)
        for name in names:
            ratios = np.array(taken[name]) / np.array(taken[FIRST])
            middle = float(np.median(taken[name]))
            row = {"size": f"{width}x{height}", "model": name, "ms": 1e3 * middle, "fps": 1 / middle}
            quarters = np.quantile(ratios, [0.25, 0.75]).tolist()
            rows.append(row | {"ratio": float(np.median(ratios)), "ratio_quarters": quarters})
    sizes = {"gaussians": len(training.gaussians), "repeats": options.repeats}
    return {"machine": machine(), **sizes, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Rendering speed",
        "",
        f"`python -m bench.speed.render_speed --write`: {result['gaussians']} Gaussians of the demo's "
        "scene, CPU, "
        f"medians of {result['repeats']} renderings each, interleaved. {words(result['machine'])}.",
        "",
        "The geometry is the same in all rows. Ratio: time over that of vanilla 3DGS, with its own cut-offs;",
        "in brackets the middle half of the repeats.",
        "",
        "| size | model | ms | frames a second | ratio |",
        "|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        low, high = row["ratio_quarters"]
        lines.append(
            f"| {row['size']} | {row['model']} | {row['ms']:.1f} | {row['fps']:.0f} | "
            f"{row['ratio']:.2f} ({low:.2f} to {high:.2f}) |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--repeats", type=int, default=100)
    parser.add_argument("--gaussians", type=int, default=20_000)
    parser.add_argument("--iterations", type=int, default=500)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.sim, options.sizes = "demo", ((320, 240), (640, 480))
    if options.quick:
        options.sim, options.sizes = "toy", ((64, 48),)
        options.gaussians, options.iterations, options.repeats = 900, 60, 8
    result = measure(options)
    deliver(options, "render_speed", result, report(result))


if __name__ == "__main__":
    main()
