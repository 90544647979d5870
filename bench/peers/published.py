"""Presets on NeRF-synthetic scenes unaided, beside published figures.

    python -m bench.peers.published [--scenes lego] [--quick] [--json] [--write] [--work FOLDER]

Scenes are folders of RIG_DATA in the layout of NeRF-synthetic (Mildenhall et al., arXiv 2003.08934), or any
such folder. Each is imported with the poses it comes with and trained with nothing set by hand; views are
those that it tests on, over white as it is published. Finished rows are kept in FOLDER. --quick: drafts.
"""

import argparse
import time
from functools import partial
from pathlib import Path
from typing import Any

from bench.peers.compare import session_of
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.spent import processor_seconds
from bench.support.trial import Cache
from recon.decide.presets import QualityName
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.scene import open_scene
from recon.train.devices.warm_up import warm_up

PUBLISHED = {
    "chair": 35.83, "drums": 26.15, "ficus": 34.87, "hotdog": 37.72,
    "lego": 35.78, "materials": 30.00, "mic": 35.36, "ship": 30.80,
}  # fmt: skip
"""dB of 3DGS (Kerbl et al., arXiv 2308.04079, table 2) at 800 px after 30,000 iterations."""


def trained(name: str, quality: QualityName, work: Path) -> dict[str, Any]:
    """Figures of one scene; `waited` and `seconds` of the processor, from the first file to the last."""
    warm_up(lambda message, done, total: None)
    session = session_of(name, work)
    before, began = processor_seconds(), time.monotonic()
    folder = reconstruct(session, TrainingRequest(quality=quality, name=f"published-{quality}", replace=True))
    seconds, waited = processor_seconds() - before, time.monotonic() - began
    metrics = evaluate(folder)
    scene = open_scene(folder)
    return {
        "seconds": seconds,
        "waited": waited,
        "width": scene.views[0].lens.width,
        "views": sum(view.use == "training" for view in scene.views),
        "tested": len(metrics.held_out),
        "iterations": metrics.iterations,
        "gaussians": metrics.gaussians,
        "white": metrics.ldr_psnr_white,
        "black": metrics.ldr_psnr_oe,
        "ssim": metrics.ssim,
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "published.jsonl")
    qualities: tuple[QualityName, ...] = ("draft",) if options.quick else ("draft", "best")
    rows = [
        {
            "scene": name,
            "quality": quality,
            **cache.get(f"{name} {quality}", partial(trained, name, quality, options.work)),
        }
        for name in options.scenes.split(",")
        for quality in qualities
    ]
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# NeRF-synthetic by presets, unaided",
        "",
        "`python -m bench.peers.published --write`: `rig reconstruct --quality`, nothing set by hand; "
        "seconds and processor seconds from the first file to the written scene; dB of the views that the "
        "scene is tested on, over white and black. 3DGS: as published, 800 px and 30,000 iterations. "
        f"{words(result['machine'])}. Some defaults were chosen on views of lego, tested ones among them.",
        "",
        "| scene | preset | px | views | tested | iterations | Gaussians | s | processor s | over white "
        "| over black | SSIM | 3DGS |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        lines.append(
            f"| {row['scene']} | {row['quality']} | {row['width']} | {row['views']} | {row['tested']} "
            f"| {row['iterations']:,} | {row['gaussians']:,} | {row['waited']:.0f} | {row['seconds']:.0f} "
            f"| {row['white']:.1f} | {row['black']:.1f} | {row['ssim']:.3f} "
            f"| {PUBLISHED.get(row['scene'], float('nan')):.1f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--scenes", default="lego")
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    deliver(options, "published", result := measure(options), report(result))


if __name__ == "__main__":
    main()
