"""Pose error above which a correction in training pays.

    python -m bench.recon.parts.refine [--quick] [--json] [--write] [--work FOLDER]

Simulated sessions whose calibration is the truth but for the poses of the views that are trained on: each is
turned and shifted at random, by a number of pixels as `rig reconstruct` counts them, half of them by either.
Each is trained twice, with poses as they are and corrected; the views that judge have their true poses.
Finished rows are kept in FOLDER/refine.jsonl. --write puts the table into bench/results/refine.md.
"""

import argparse
import shutil
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache, session
from drivers.sim.truth import pose_of
from imaging.files import store
from imaging.files.colmap import read_points
from imaging.optics.pose import Pose
from imaging.session.calibration import CalibrationRecord, read_calibration
from recon.data.dataset import Dataset
from recon.data.load import load
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.decide.settings import Settings
from recon.decide.steps.corrections import KNOWN_PX, tried
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct

SCENES = (("demo", 0), ("gallery", 0))
PIXELS = (0.0, 0.15, 0.3, 0.6)
WIDTH, ITERATIONS, GAUSSIANS, DEGREE = 160, 1000, 8000, 1


def away(dataset: Dataset) -> float:
    """Median depth of the scene points in the views, in units of the scene."""
    xyz = read_points(dataset.session / "calibration" / "colmap").xyz
    return float(np.median([np.linalg.norm(xyz - view.centre, axis=1) for view in dataset.train]))


def disturbed(record: CalibrationRecord, dataset: Dataset, px: float, seed: int) -> CalibrationRecord:
    """The views that are trained on, each turned and shifted."""
    rng = np.random.Generator(np.random.PCG64([seed, 0x9E7]))
    trained = {view.id for view in dataset.train}
    far, views = away(dataset), []
    for view in record.views:
        turn, shift = px / 2 / dataset.train[0].lens.fx * rng.standard_normal((2, 3))
        quaternion = np.array([1.0, *(turn / 2)]) / np.linalg.norm([1.0, *(turn / 2)])
        w, x, y, z = quaternion.tolist()
        small = Pose(quaternion=(w, x, y, z), translation=tuple((far * shift).tolist()))
        if view.id in trained:
            view = view.model_copy(
                update={"cam_from_world": pose_of(small.matrix() @ view.cam_from_world.matrix())}
            )
        views.append(view)
    return record.model_copy(update={"views": tuple(views)})


def made_wrong(rig: str, seed: int, px: float, options: argparse.Namespace) -> Path:
    """The session with poses off by so much."""
    folder: Path = options.work / f"refine-{rig}-{seed}"
    if not folder.exists():
        shutil.copytree(session(options.work, rig, seed, "truth"), folder)
    true = options.work / f"{rig}-{seed}-truth"
    record = disturbed(read_calibration(true), load(true, max_width=options.width), px, seed)
    store.write_json(folder / "calibration" / "calibration.json", record.model_dump(mode="json"))
    return folder


def trained(folder: Path, seed: int, options: argparse.Namespace) -> dict[str, float]:
    """dB of held-out pictures, with poses as they are and corrected."""
    figures = {}
    for name, refine in (("as they are", "none"), ("corrected", "poses")):
        overrides = Overrides(
            refine=refine, width=options.width, iterations=options.iterations, gaussians=GAUSSIANS,
            degree=DEGREE,
        )  # fmt: skip
        made = reconstruct(
            folder,
            TrainingRequest(
                method="nh-3dgs", overrides=overrides, name=f"refine-{refine}", seed=seed, replace=True
            ),
        )
        figures[name] = evaluate(made).known()["raw_psnr"]
    return figures


def trial(folder: Path, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Return what a trial says."""
    settings = Settings(
        method="nh-3dgs", quality="standard", seed=seed, iterations=options.iterations,
        max_gaussians=GAUSSIANS, max_width=options.width,
    )  # fmt: skip
    small = load(folder, max_width=options.width)
    rung = tried(small, ["poses"], settings, lambda message, done, total: None)["poses"]
    return {"trial": rung.gain, "error": rung.standard_error, "taken": rung.taken}


def gain(one: dict[str, Any]) -> float:
    return float(one["corrected"] - one["as they are"])


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, rows = Cache(options.work / "refine.jsonl"), []
    scenes, pixels = ((("toy", 0),), (0.0, 1.0)) if options.quick else (SCENES, PIXELS)
    for px in pixels:
        for rig, seed in scenes:
            name = f"{rig} {seed} {px}"
            folder = made_wrong(rig, seed, px, options)
            one = cache.get(name, partial(trained, folder, seed, options))
            trial_row = cache.get(f"{name} trial", partial(trial, folder, seed, options))
            rows.append({"rig": rig, "seed": seed, "px": px, **one, **trial_row})
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# From which error on poses are to be corrected",
        "",
        f"`python -m bench.recon.parts.refine --write`, {words(result['machine'])}. {WIDTH} px, {ITERATIONS} "
        f"iterations, {GAUSSIANS} Gaussians; dB of held-out pictures (`raw_psnr`), which have their true "
        "poses. Trial: what `rig reconstruct` would find before it trains, unless the calibration "
        f"states {KNOWN_PX:g} px or less.",
        "",
        "| scene | px off | dB as they are | gained when corrected | trial: dB | taken |",
        "|---|---|---|---|---|---|",
    ]
    for one in result["rows"]:
        lines.append(
            f"| {one['rig']} {one['seed']} | {one['px']:g} | {one['as they are']:.2f} "
            f"| {gain(one):+.2f} | {one['trial']:+.2f} +- {one['error']:.2f} "
            f"| {'yes' if one['taken'] else 'no'} |"
        )
    lines.append("")
    for px in dict.fromkeys(one["px"] for one in result["rows"]):
        of_px = [one for one in result["rows"] if one["px"] == px]
        lines.append(
            f"{px:g} px: {fmean(gain(one) for one in of_px):+.2f} dB in the mean over {len(of_px)} scenes."
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.width, options.iterations = WIDTH, ITERATIONS
    if options.quick:
        options.work, options.width, options.iterations = options.work / "quick", 48, 60
    result = measure(options)
    deliver(options, "refine", result, report(result))


if __name__ == "__main__":
    main()
