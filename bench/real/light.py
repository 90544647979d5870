"""Exposure and white balance of photographs: the gain of each part where it is needed, and its cost
elsewhere.

    python -m bench.real.light [--quick] [--json] [--write] [--seeds 1] [--work FOLDER] [--sets banana,...]

Real photographs under RIG_DATA, 1,000 px or less on the long side, and the demo's views as photographs, as
bench/recon/auto_exposure.py develops them. Each set is calibrated once, and trained (preset draft) from the
same poses by three rules. `off`: no part. `points`: every part that held-out points ask for by two standard
errors, by scene points alone. `taken`: the parts that calibration takes, by the files and by regions that
have to agree. Held-out photographs are judged as recorded, and once more after a gain of each channel that is
fitted to them. Rows are kept in FOLDER. --quick: banana.
"""

import argparse
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from bench.recon.auto_exposure import CASES, photographed
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.calibrate import calibrate
from calib.colour.colour_record import with_development
from calib.data.views import scene_views
from calib.light import each_photograph
from calib.light.constant_settings import NOTHING
from calib.light.each_photograph import Development
from capture.imports.photos import import_photos
from capture.imports.request import ImportRequest
from imaging import metrics
from imaging.errors import PartialError
from imaging.files import store
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from recon.decide.request import TrainingRequest
from recon.observe.shot_comparison import as_recorded
from recon.reconstruct import reconstruct
from recon.result.opened import open_model

REAL: Mapping[str, tuple[str, int, int]] = {
    "banana": ("banana/*.JPG", 960, 1),
    "fox": ("fox/images/*.jpg", 640, 2),
    "sceaux": ("sceaux/*.JPG", 960, 1),
    "monstree": ("monstree/*.jpg", 800, 1),
    "brighton": ("brighton/*.JPG", 1000, 1),
}
"""Files, px of the long side, and their stride."""
MADE = {f"demo {name}": name for name in CASES}
RULES = ("off", "points", "taken")
FRAMES = 3
"""Number of frames of the demo, each of four views."""


def session_of(name: str, work: Path) -> Path:
    """The set, imported and calibrated; beside it what each rule takes."""
    folder = work / f"light-{name.replace(' ', '-')}"
    session = folder / "S"
    if not (session / "session.json").exists():
        photographs = folder / "photographs"
        if name in REAL:
            scaled(name, photographs)
        else:
            photographs, _ = photographed(folder, CASES[MADE[name]], 0, FRAMES)
        import_photos(photographs, session, ImportRequest(bracket=1))
    if not (folder / "developments.json").exists():
        developments: dict[str, Development] = {}
        with patch("calib.light.each_photograph.estimate", partial(_all_rules, developments)):
            try:
                calibrate(session)
            except PartialError as error:
                print(error)
        by_rule = {rule: _as_json(development) for rule, development in developments.items()}
        store.write_json(folder / "developments.json", by_rule)
    return session


def scaled(name: str, folder: Path) -> None:
    """Copies of a real set's photographs, with what their files say."""
    pattern, long_side, every = REAL[name]
    folder.mkdir(parents=True)
    for path in sorted(Path(os.environ["RIG_DATA"]).glob(pattern))[::every]:
        with Image.open(path) as picture:
            factor = long_side / max(picture.size)
            size = (round(picture.width * factor), round(picture.height * factor))
            exif = {"exif": picture.info["exif"]} if "exif" in picture.info else {}
            small = picture.resize(size, Image.Resampling.LANCZOS)
            small.save(folder / path.name, quality=95, subsampling=0, **exif)


_estimate = each_photograph.estimate


def _all_rules(by_rule: dict[str, Development], observations: Any, views: Any, *evidence: Any) -> Development:
    """Return what calibration takes; by_rule: what each rule would, of its last estimate."""
    with patch.object(each_photograph, "MOST_REMAINING", np.inf):
        by_rule["points"] = _estimate(observations, views, NOTHING)
    by_rule["off"] = Development({}, {})
    by_rule["taken"] = _estimate(observations, views, *evidence)
    return by_rule["taken"]


def _as_json(development: Development) -> dict[str, Any]:
    return {
        "exposure": {str(view): factor for view, factor in development.exposure.items()},
        "white_balance": {str(view): list(factors) for view, factors in development.white_balance.items()},
        "rungs": [rung.model_dump(mode="json") for rung in development.rungs],
    }


def as_labelled(session: Path, record: CalibrationRecord) -> CalibrationRecord:
    """A calibration of single photographs that does not know what each was developed with."""
    files = {shot.view: shot.file for shot in Session.open(session).shots("scene")}
    scale = dict(record.exposure_scale)
    for view in record.views:
        scale[files[view.id]] /= view.exposure
    alike = {"exposure": 1.0, "white_balance": (1.0, 1.0, 1.0)}
    views = tuple(view.model_copy(update=alike) for view in record.views)
    return record.model_copy(update={"views": views, "exposure_scale": scale})


def record_by(session: Path, rule: str) -> CalibrationRecord:
    """The calibration with what a rule takes."""
    opened = Session.open(session)
    record = as_labelled(session, read_calibration(session))
    stored = store.read_json(session.parent / "developments.json")[rule]
    views = {str(view.id): view.id for view in record.views}

    def of(values: Mapping[str, Any]) -> dict[ViewId, Any]:
        return {views[name]: value for name, value in values.items() if name in views}

    balances = {view: tuple(value) for view, value in of(stored["white_balance"]).items()}
    development = Development(of(stored["exposure"]), balances)
    return with_development(record, development, scene_views(opened))


def trained(options: argparse.Namespace, name: str, rule: str, seed: int) -> dict[str, Any]:
    """Figures of one training."""
    session = session_of(name, options.work)
    file = session / "calibration" / "calibration.json"
    before = file.read_bytes()
    record = record_by(session, rule)
    try:
        store.write_json(file, record.model_dump(mode="json"))
        made = reconstruct(session, TrainingRequest(quality="draft", seed=seed, name=rule, replace=True))
        return figures(made)
    finally:
        store.write_bytes(file, before)


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


def evidence(session: Path) -> dict[str, Any]:
    """Return what was placed, what points and the calibration say of each part, and its falloff."""
    stored = store.read_json(session.parent / "developments.json")
    record = read_calibration(session)
    falloff = next((rung for rung in record.rungs if rung.name == "vignetting"), None)
    return {
        "placed": len(record.views),
        "views": len(record.views) + len(record.unregistered),
        "points": stored["points"]["rungs"],
        "taken": stored["taken"]["rungs"],
        "falloff": None if falloff is None else falloff.model_dump(mode="json"),
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set."""
    cache, rows = Cache(options.work / "light.jsonl"), []
    for name in options.sets:
        looked_at = evidence(session_of(name, options.work))
        row: dict[str, Any] = {"set": name, **looked_at}
        for rule in RULES:
            row[rule + "_trained"] = [
                cache.get(f"{name} {rule} {seed}", partial(trained, options, name, rule, seed))
                for seed in range(options.seeds)
            ]
        rows.append(row)
    return {
        "machine": machine(),
        "command": f"--seeds {options.seeds} --sets '{','.join(options.sets)}'",
        "rows": rows,
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Light of photographs: what each part gains and costs",
        "",
        f"`python -m bench.real.light --write {result['command']}`: preset draft (320 px wide), means over "
        f"the seeds. {words(result['machine'])}.",
        "",
        "Exposure and white balance of each photograph: none (off), as points alone would have them, and as",
        "calibration takes them. left: how much held-out parts of the scene differ between photographs with",
        "it, of what they do without, between photographs from one side where there are enough. dB of",
        "held-out photographs, in brackets after a gain of each channel that is fitted to them.",
        "",
        "| set | placed | exposure, left | white balance, left | taken | falloff | off | by points | taken |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        lefts = [_remaining_share(rung["reason"]) for rung in row["points"]]
        taken = [rung["name"].removesuffix("_each_photograph") for rung in row["taken"] if rung["taken"]]
        falloff = "taken" if row["falloff"] is not None and row["falloff"]["taken"] else "no"
        cells = [row["set"], f"{row['placed']} of {row['views']}", *lefts]
        cells += [" and ".join(taken).replace("_", " ") or "nothing", falloff]
        for rule in RULES:
            one = row[rule + "_trained"]
            means = [np.mean([each[key] for each in one]) for key in ("psnr", "psnr_fitted")]
            cells.append(f"{means[0]:.2f} ({means[1]:.2f})")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _remaining_share(reason: str) -> str:
    """The share that a rung says is left."""
    before, separator, _ = reason.partition(" % as much as without it")
    return f"{before.rsplit(' ', 1)[1]} %" if separator else ""


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", default=",".join((*REAL, *MADE)))
    options = parser.parse_args()
    options.sets = ["banana"] if options.quick else options.sets.split(",")
    result = measure(options)
    deliver(options, "real_light", result, report(result))


if __name__ == "__main__":
    main()
