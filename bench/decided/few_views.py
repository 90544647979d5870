"""Dependence of colours on the direction with only a few views.

    python -m bench.decided.few_views [--quick] [--json] [--write] [--work FOLDER]

Rigs of four cameras at one place and at two, with their true calibration, trained with harmonics of each
degree. So few views do not determine the degree themselves (recon/decide/view_dependence.py asks for eight
that see a point), so that this table determines it. Finished rows are kept in FOLDER.
"""

import argparse
import shutil
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from bench.support.oracle import oracle_session
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from drivers.sim.rigs import simulate
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.train.warm_up import warm_up

GLOSS = 0.12
"""Gloss of all surfaces, as in the view-dependent scenes of bench/recon/ladder.py."""
SCENES = [
    (rig, gloss, frames)
    for rig, gloss in (("demo", None), ("gallery", None), ("demo", GLOSS))
    for frames in (1, 2)
]
DEGREES = (0, 1, 2)
USUAL = Quality(1000, 10_000, 160)
TINY = Quality(40, 300, 64)


def train(rig: str, gloss: float | None, frames: int, work: Path) -> dict[str, Any]:
    """Held-out dB of pictures and light, by degree."""
    folder = work / f"{rig}-{gloss or 'own'}-{frames}"
    altered = partial(simulate) if gloss is None else partial(simulate, gloss=gloss)
    with (
        mock.patch("capture.simulated.simulate", altered),
        mock.patch("bench.support.oracle.simulate", altered),
    ):
        oracle_session(folder, rig, frames=frames)
    warm_up(lambda message, done, total: None)
    found = {}
    for degree in DEGREES:
        made = reconstruct(
            folder,
            method="nh-3dgs",
            overrides=Overrides(refine="none", degree=degree),
            name=f"degree-{degree}",
        )
        metrics = evaluate(made).known()
        found[str(degree)] = {
            "db": metrics["raw_psnr"],
            "truth_db": metrics["hdr_psnr_mu_aligned"],
            "size_bytes": metrics["size_bytes"],
        }
        shutil.rmtree(made)
    return found


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, rows = Cache(options.work / "few_views.jsonl"), []
    for rig, gloss, frames in options.scenes:
        name = rig + (f", gloss {gloss:g}" if gloss else "")
        job = partial(train, rig, gloss, frames, options.work)
        rows.append({"scene": name, "views": 4 * frames, "degrees": cache.get(f"{name} {frames}", job)})
    return {"machine": machine(), "preset": vars(QUALITIES["standard"]), "rows": rows}


def report(result: dict[str, Any]) -> str:
    preset = result["preset"]
    lines = [
        "# Direction-dependent colour of a few views",
        "",
        f"`python -m bench.decided.few_views --write`, {words(result['machine'])}. NH-3DGS on RAW brackets "
        f"{preset['width']} px wide, {preset['iterations']} iterations, {preset['gaussians']:,} Gaussians; "
        "one view in eight is held out. Held-out pictures / light, dB, with harmonics of each degree; times "
        "smaller: the file of degree 0 than that of degree 2.",
        "",
        "| scene | views | degree 0 | degree 1 | degree 2 | times smaller |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        own = row["degrees"]
        cells = " | ".join(f"{one['db']:.2f} / {one['truth_db']:.2f}" for one in own.values())
        smaller = own["2"]["size_bytes"] / own["0"]["size_bytes"]
        lines.append(f"| {row['scene']} | {row['views']} | {cells} | {smaller:.1f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK / "few-views")
    options = parser.parse_args()
    options.scenes, QUALITIES["standard"] = SCENES, USUAL
    if options.quick:
        options.scenes, QUALITIES["standard"] = SCENES[:1], TINY
        options.work = options.work / "quick"
    result = measure(options)
    deliver(options, "few_views", result, report(result))


if __name__ == "__main__":
    main()
