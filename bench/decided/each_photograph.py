"""Photographs that their camera exposed by itself: by which method, and is what calibration found worth it.

    python -m bench.decided.each_photograph [--quick] [--json] [--write] [--seeds 3] [--work FOLDER]
        [--sessions sceaux,monstree] [--quality draft]

Real photographs under RIG_DATA, calibrated once a session. `own`: with the exposures and white balances that
calibration found; `labels`: as if each photograph were as its label says, so that vanilla knows nothing.
Held-out photographs are predicted with what the row knows of them, which is the calibration's as for those
that are trained on; and once more, all rows alike, after a gain of each channel that is fitted to the
held-out photograph. Finished rows are kept in FOLDER. --quick: the castle, one seed.
"""

import argparse
import os
import shutil
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from imaging import metrics
from imaging.files import store
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.session import Session
from recon.observe.recorded import as_recorded
from recon.reconstruct import MethodName, reconstruct
from recon.result.scene import open_model

METHODS: tuple[MethodName, ...] = ("vanilla", "hdr-gs")


def session_of(name: str, known: str, work: Path) -> Path:
    """The session as calibrated, or with all photographs as labelled."""
    folder = work / f"each-photograph-{name}" / "own"
    if not (folder / "calibration" / "calibration.json").exists():
        import_photos(Path(os.environ["RIG_DATA"]) / name, folder)
        calibrate(folder)
    if known == "own":
        return folder
    labelled = folder.parent / "labels"
    if not labelled.exists():
        with store.replacing(labelled) as part:
            shutil.copytree(folder, part, ignore=shutil.ignore_patterns("reconstructions"))
            record = as_labelled(part, read_calibration(part))
            store.write_json(part / "calibration" / "calibration.json", record.model_dump(mode="json"))
    return labelled


def as_labelled(session: Path, record: CalibrationRecord) -> CalibrationRecord:
    """A calibration of single photographs that does not know what each was developed with."""
    files = {shot.view: shot.file for shot in Session.open(session).shots("scene")}
    scale = dict(record.exposure_scale)
    for view in record.views:
        scale[files[view.id]] /= view.exposure
    alike = {"exposure": 1.0, "white_balance": (1.0, 1.0, 1.0)}
    views = tuple(view.model_copy(update=alike) for view in record.views)
    return record.model_copy(update={"views": views, "exposure_scale": scale})


def trained(options: argparse.Namespace, name: str, known: str, method: MethodName, seed: int) -> Any:
    """Figures of one training."""
    folder = session_of(name, known, options.work)
    made = reconstruct(folder, method=method, quality=options.quality, seed=seed, name="scene", replace=True)
    return figures(made)


@torch.no_grad()
def figures(made: Path) -> dict[str, float]:
    """PSNR and SSIM of the held-out photographs, as predicted and after gains that are fitted; seconds."""
    opened, rows = open_model(made), []
    for view in opened.dataset.reported:
        (shot,) = view.shots
        image = opened.training.method.observation.predict(opened.render(view.lens), view, shot.k)
        ours, true = as_recorded(image, shot)
        row = {}
        for suffix, one in (("", ours), ("_fitted", fitted(ours, true))):
            error = (one - true)[torch.from_numpy(shot.valid)].double().square().mean()
            row["psnr" + suffix] = -10 * float(torch.log10(error))
            ssim = metrics.ssim(one.numpy(), true.numpy(), shot.valid)
            assert ssim is not None  # no mask hides these photographs
            row["ssim" + suffix] = ssim
        rows.append(row)
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    return means | {"seconds": opened.record.train_seconds}


def fitted(ours: Tensor, true: Tensor) -> Tensor:
    """Display values [H, W, 3] with the gain of each channel that brings them nearest to others."""
    gain = (ours * true).sum((0, 1)) / ours.square().sum((0, 1)).clamp_min(1e-12)
    return (ours * gain).clamp(0, 1)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, rows = Cache(options.work / "each-photograph.jsonl"), []
    for name, known, method in product(options.sessions, ("labels", "own"), METHODS):
        trainings = [
            cache.get(
                f"{name} {options.quality} {known} {method} {seed}",
                partial(trained, options, name, known, method, seed),
            )
            for seed in range(options.seeds)
        ]
        rows.append({"session": name, "known": known, "method": method, "trainings": trainings})
    command = f"--sessions {','.join(options.sessions)} --quality {options.quality} --seeds {options.seeds}"
    return {"machine": machine(), "command": command, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Photographs that were exposed one by one: which method",
        "",
        f"`python -m bench.decided.each_photograph --write {result['command']}`: means and standard "
        f"deviations over the seeds. {words(result['machine'])}.",
        "",
        "`own`: with the exposures and white balances that calibration found; `labels`: without. Of held-out",
        "photographs, as predicted, and after a gain of each channel that is fitted to them.",
        "",
        "| session | taken as | method | PSNR | SSIM | PSNR, gains fitted | SSIM, gains fitted |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        cells = [row["session"], row["known"], row["method"]]
        for key, digits in (("psnr", 2), ("ssim", 3), ("psnr_fitted", 2), ("ssim_fitted", 3)):
            values = [one[key] for one in row["trainings"]]
            spread = f" +- {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else ""
            cells.append(f"{np.mean(values):.{digits}f}{spread}")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=3)
    parser.add_argument("--sessions", default="sceaux,monstree")
    parser.add_argument("--quality", default="draft", choices=("draft", "standard", "best"))
    options = parser.parse_args()
    options.sessions = ["sceaux"] if options.quick else options.sessions.split(",")
    options.seeds = 1 if options.quick else options.seeds
    result = measure(options)
    deliver(options, "each_photograph", result, report(result))


if __name__ == "__main__":
    main()
