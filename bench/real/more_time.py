"""Draft and standard on real sets of few photographs, at one width: what more time buys or costs there.

    python -m bench.real.more_time [--quick] [--json] [--write] [--seeds 1] [--work FOLDER]

Both have their own iterations and Gaussians. The width is set by hand, so that no trial of the number of
Gaussians or of corrections is made. One view in eight is held out, as `rig evaluate` has it. Finished rows
are kept in FOLDER. --quick: the castle.
"""

import argparse
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.real.compare import session_of
from bench.real.neutral import measured
from bench.real.peer_folder import picture_of
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.arrays import Array
from recon.data.dataset import View
from recon.decide.overrides import Overrides
from recon.decide.presets import QualityName
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.result.opened import open_model
from recon.train.warm_up import warm_up

SETS = ("castle", "monstree", "banana", "brighton")
PRESETS: tuple[QualityName, ...] = ("draft", "standard")
WIDTH = 400


def trained(session: Path, preset: QualityName, seed: int) -> dict[str, Any]:
    """Figures of one training; `seconds` of the processor, from the first file to the written scene."""
    warm_up(lambda message, done, total: None)
    overrides = Overrides(width=WIDTH)
    request = TrainingRequest(
        quality=preset, seed=seed, overrides=overrides, name=f"time-{preset}", replace=True
    )
    began = time.process_time()
    folder = reconstruct(session, request)
    seconds = time.process_time() - began
    opened, settings = open_model(folder), read_model(folder).settings
    views, observation = list(opened.dataset.held_out), opened.training.method.observation

    def drawn(view: View) -> Array:
        (shot,) = view.shots
        image = observation.predict(opened.render(view.lens), view, shot.k)
        return np.asarray(image.double().numpy())

    figures = measured(views, [picture_of(view) for view in views], drawn)
    size = {"iterations": settings.iterations, "gaussians": settings.max_gaussians}
    return {"seconds": seconds, **size, **vars(figures)}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set, preset and seed."""
    cache, rows = Cache(options.work / "real-more-time.jsonl"), []
    sets = SETS[:1] if options.quick else SETS
    for name, preset, seed in product(sets, PRESETS, range(options.seeds)):

        def made(name: str = name, preset: QualityName = preset, seed: int = seed) -> dict[str, Any]:
            return trained(session_of(name, options.work), preset, seed)

        what = {"set": name, "preset": preset, "seed": seed}
        rows.append(what | cache.get(f"{name} {preset} {seed}", made))
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Real sets of few photographs: what more time buys",
        "",
        f"`python -m bench.real.more_time --write`: {WIDTH} px wide, no trials. {words(result['machine'])}.",
        "",
        "Held-out dB after a gain a channel, and SSIM. Seconds are of the processor, from the first file to "
        "the scene.",
        "",
        "| set | seed | preset | dB | SSIM | iterations | Gaussians | processor s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        lines.append(
            f"| {row['set']} | {row['seed']} | {row['preset']} | {row['gained']:.2f} | {row['ssim']:.3f} "
            f"| {row['iterations']:,} | {row['gaussians']:,} | {row['seconds']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__, seeds=1).parse_args()
    result = measure(options)
    deliver(options, "real_more_time", result, report(result))


if __name__ == "__main__":
    main()
