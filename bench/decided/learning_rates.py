"""Learning rates by the length of a training: the usual ones times several factors.

    python -m bench.decided.learning_rates [--quick] [--json] [--write] [--work FOLDER] [--ladder FOLDER]

Three scenes of bench/recon/presets.py, in FOLDER of --work, and two of bench/recon/ladder.py, in that of
--ladder, trained as `rig reconstruct --quality draft` trains them (at most 20,000 Gaussians, 320 px), with
schedules of 25 to 1000 iterations. Finished rows are kept in --work.
"""

import argparse
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from bench.recon import ladder_scenes
from bench.recon.presets import SCENES, TOYS, folder_of
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from recon.decide.overrides import Overrides
from recon.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.train.learning_rates import rate_factor
from recon.train.warm_up import warm_up

FACTORS = {
    25: (1, 3, 4, 6, 8, 10),
    50: (1, 3, 4, 6, 8),
    100: (1, 2, 2.8, 4, 5.6),
    300: (1, 1.4, 2, 2.8, 4),
    1000: (1, 1.4, 2),
}
LADDER = ("linear 0", "HDR 0")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, rows = Cache(options.work / "learning_rates.jsonl"), []
    folders = {scene.name: (folder_of, scene, options.work) for scene in options.scenes}
    folders |= {one.name: (ladder_scenes.session, one, options.ladder) for one in options.kinds}
    for name, (session, scene, work) in folders.items():
        for iterations, factor in [(n, factor) for n, all_of in options.factors.items() for factor in all_of]:
            key = f"{name} {iterations} {factor:g}"
            found = cache.get(key, partial(one, partial(session, scene, work), iterations, factor))
            rows.append({"scene": name, "iterations": iterations, "factor": factor} | found)
    return {"machine": machine(), "rows": rows}


def one(session: Callable[[], Path], iterations: int, factor: float) -> dict[str, float]:
    """Held-out dB, and dB to the truth, of a whole training at that factor on the usual rates."""
    folder = session()
    warm_up(lambda message, done, total: None)
    with mock.patch("recon.decide.settings.rate_factor", return_value=factor):
        made = reconstruct(
            folder, quality="draft", overrides=Overrides(iterations=iterations), name="learning_rates"
        )
    metrics = evaluate(made).known()
    shutil.rmtree(made)
    db = metrics["raw_psnr"] if "raw_psnr" in metrics else metrics["ldr_psnr_oe"]
    return {"db": round(db, 2), "truth_db": round(metrics["hdr_psnr_mu_aligned"], 2)}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Learning rates by the length of a training",
        "",
        f"`python -m bench.decided.learning_rates --write`, {words(result['machine'])}. Held-out pictures / "
        "light, dB, at multiples of the usual rates, of at most 20,000 Gaussians; taken: the factor of "
        "`recon.train.learning_rates`.",
        "",
        "| iterations | taken | scene | factor: pictures / light, dB |",
        "|---|---|---|---|",
    ]
    rows = result["rows"]
    for iterations in sorted({row["iterations"] for row in rows}):
        for name in dict.fromkeys(row["scene"] for row in rows):
            own = [row for row in rows if (row["iterations"], row["scene"]) == (iterations, name)]
            each = [f"{row['factor']:g}: {row['db']:.2f} / {row['truth_db']:.2f}" for row in own]
            if each:
                lines.append(f"| {iterations} | {rate_factor(iterations):.2f} | {name} | {', '.join(each)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument(
        "--ladder", type=Path, default=WORK, help="where the sessions of bench/recon/ladder.py are"
    )
    options = parser.parse_args()
    options.scenes, options.factors = SCENES[:3], FACTORS
    options.kinds = [one for one in ladder_scenes.scenes() if one.name in LADDER]
    if options.quick:
        options.scenes, options.kinds, options.factors = TOYS, [], {50: (1, 4)}
    result = measure(options)
    deliver(options, "learning_rates", result, report(result))


if __name__ == "__main__":
    main()
