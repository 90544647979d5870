"""Held-out quality over the length of a training, on which forecasts rest.

    python -m bench.recon.learning_curves [--quick] [--json] [--write] [--longest 45] [--work FOLDER]
                                    [--ladder FOLDER]

Scenes of bench/recon/presets.py, in FOLDER of --work, and the first of each kind of
bench/recon/parts/ladder.py, in that of --ladder, trained at the preset `best` with whole schedules of 6 to
3200 iterations, until one takes more than --longest seconds; some of them narrower or with few Gaussians
too, and the real photographs where RIG_DATA names the folder that has them. A curve is fitted to each
(recon.decide.cost.prediction), and each is predicted from each of its schedules by the curves of scenes of
other kinds. Finished rows are kept in --work. --write puts the table into bench/results/learning_curves.md
and the curves into learning_curves.json, which a test holds the curves of recon.decide.cost.prediction
against.
"""

import argparse
import os
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from bench.recon.parts import ladder_scenes
from bench.recon.presets import CASTLE, SCENES, TOYS, folder_of
from bench.support.record import RESULTS, WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.files import store
from recon.decide.cost.prediction import lacking, predicted
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.train.devices.warm_up import warm_up

LENGTHS = (6, 12, 25, 50, 100, 200, 400, 800, 1600, 3200)
FIRST = np.log([12.0, 40.0, 1.3])
BOUNDS = np.log([[0.5, 2.0, 0.3], [40.0, 1000.0, 4.0]])
"""Bounds of rise, half and power: a curve that was rising from the first has no certain half."""
CHANGED = (
    ("demo 0", Overrides(gaussians=5000)),
    ("linear 0", Overrides(gaussians=4000)),
    ("sRGB curve 0", Overrides(gaussians=4000)),
    ("demo 0", Overrides(width=160)),
    ("gallery 0", Overrides(width=160, gaussians=8000)),
    ("sceaux 0", Overrides(width=640)),
)
Row = dict[str, Any]


def measure(options: argparse.Namespace) -> Row:
    cache, rows = Cache(options.work / "learning-curves.jsonl"), []
    folders = {scene.name: partial(folder_of, scene, options.work) for scene in options.scenes}
    folders |= {one.name: partial(ladder_scenes.session, one, options.ladder) for one in options.kinds}
    jobs = [(name, Overrides()) for name in folders if name != CASTLE.name]
    for name, overrides in [*jobs, *(job for job in CHANGED if job[0] in folders)]:
        key = ", ".join([name, *overrides.words()])
        row = cache.get(key, partial(measured, folders[name], overrides, options))
        rows.append({"scene": key, "kind": kind(name)} | row)
    for row in rows:
        row["fit"], row["rms"] = fitted(row["curve"])
    return {"machine": machine(), "rows": rows, "forecasts": forecasts(rows)}


def measured(folder: Callable[[], Path], overrides: Overrides, options: argparse.Namespace) -> Row:
    return {"curve": curve(folder(), overrides, options)}


def curve(folder: Path, overrides: Overrides, options: argparse.Namespace) -> list[tuple[int, float]]:
    """Iterations and held-out dB of whole trainings, ever longer ones."""
    points: list[tuple[int, float]] = []
    warm_up(lambda message, done, total: None)
    for length in options.lengths:
        changed = overrides.model_copy(update={"iterations": length})
        made = reconstruct(folder, TrainingRequest(quality="best", overrides=changed, name="length"))
        record = read_model(made)
        shutil.rmtree(made)
        assert record.held_out_db is not None
        points.append((length, round(record.held_out_db, 3)))
        if record.train_seconds + record.measuring_seconds > options.longest:
            break
    return points


def kind(name: str) -> str:
    """Scenes of one kind look alike: one of them is predicted by none of the others."""
    rig = name.split(",")[0].rpartition(" ")[0]
    return rig.removesuffix("-ldr")


def fitted(curve: Sequence[tuple[int, float]]) -> tuple[list[float], float]:
    """Log rise, log half and log power of the curve through these points, and what it leaves in dB, RMS."""
    lengths, db = np.array(curve).T

    def residuals(values: np.ndarray) -> np.ndarray:
        end = db + np.concatenate([lacking(values[None], n) for n in lengths])
        return np.asarray(end - end.mean())

    fit = least_squares(residuals, FIRST, bounds=tuple(BOUNDS))
    return [round(float(value), 2) for value in fit.x], float(np.sqrt(np.mean(fit.fun**2)))


def forecasts(rows: Sequence[Row]) -> list[Row]:
    """Each scene predicted from each of its schedules, by the curves of scenes of other kinds."""
    compared = []
    for row in rows:
        others = np.array([other["fit"] for other in rows if other["kind"] != row["kind"]])
        for (tried, db), (longer, reached) in combinations(row["curve"], 2) if len(others) > 1 else ():
            guess = predicted(db, tried, longer, others)
            one = {"scene": row["scene"], "from": tried, "to": longer, "error": round(guess.db - reached, 2)}
            one |= {"half": round((guess.high - guess.low) / 2, 2)}
            compared.append(one | {"inside": guess.low <= reached <= guess.high})
    return compared


def report(result: Row) -> str:
    lines = [
        "# What is predicted of a training",
        "",
        f"`python -m bench.recon.learning_curves --write`, {words(result['machine'])}. Held-out dB "
        "after whole "
        "schedules of given lengths at the preset best, and the curve end - rise / (1 + (n / "
        "half)^power) through them; left: what it leaves, RMS.",
        "",
        f"| scene | {' | '.join(str(n) for n in LENGTHS)} | rise, dB | half | power | left, dB |",
        "|---|" + "---|" * (len(LENGTHS) + 4),
    ]
    for row in result["rows"]:
        by_length = {n: f"{db:.1f}" for n, db in row["curve"]}
        rise, half, power = np.exp(row["fit"])
        cells = [by_length.get(n, "") for n in LENGTHS]
        cells += [f"{rise:.1f}", f"{half:.0f}", f"{power:.2f}", f"{row['rms']:.2f}"]
        lines.append(f"| {row['scene']} | {' | '.join(cells)} |")
    lines += [
        "",
        "Predicted from schedules of n iterations, by the curves of the scenes of other kinds:",
        "",
        "| n | times longer | scenes | bias, dB | RMS, dB | interval, +- dB | inside |",
        "|---|---|---|---|---|---|---|",
    ]
    pairs = sorted({(one["from"], one["to"]) for one in result["forecasts"]})
    for begin, end in pairs:
        of_span = [one for one in result["forecasts"] if (one["from"], one["to"]) == (begin, end)]
        errors = np.array([one["error"] for one in of_span])
        lines.append(
            f"| {begin} | {end / begin:.0f} | {len(of_span)} | {errors.mean():+.2f} "
            f"| {np.sqrt(np.mean(errors**2)):.2f} | {np.mean([one['half'] for one in of_span]):.1f} "
            f"| {sum(one['inside'] for one in of_span)} |"
        )
    if result["forecasts"]:
        share = np.mean([one["inside"] for one in result["forecasts"]])
        lines += ["", f"Of {len(result['forecasts'])} forecasts {100 * share:.0f} % hold (85 to 99)."]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--longest", type=float, default=45.0, help="seconds of a scene's longest training")
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument(
        "--ladder", type=Path, default=WORK, help="where the sessions of bench/recon/parts/ladder.py are"
    )
    options = parser.parse_args()
    options.lengths = LENGTHS
    real = (CASTLE,) if os.environ.get("RIG_DATA") else ()
    options.scenes, options.kinds = (*SCENES, *real), [one for one in ladder_scenes.scenes() if one.seed == 0]
    if options.quick:
        options.scenes, options.kinds, options.lengths = TOYS, [], LENGTHS[:5]
    result = measure(options)
    deliver(options, "learning_curves", result, report(result))
    if options.write:
        store.write_json(RESULTS / "learning_curves.json", {"rows": result["rows"]})


if __name__ == "__main__":
    main()
