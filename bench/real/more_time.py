"""Presets on real sets of few photographs, at one width: what more time buys or costs there.

    python -m bench.real.more_time [--quick] [--json] [--write] [--seeds 1] [--work FOLDER] [--sets ...]

Every view is held out once, in four trainings of each preset that hold out one view in four. Presets have
their own iterations and Gaussians; the width is set by hand, so that no trial of the number of Gaussians or
of corrections is made. A plane sweep of all photographs separates the pixels whose depth another photograph
confirms from the others, whose surface no training view may have seen. Finished rows are kept in FOLDER.
--quick: the castle.
"""

import argparse
import os
import shutil
import time
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.peers.compare import session_of
from bench.peers.peer_folder import picture_of
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging import metrics
from imaging.arrays import Array, Mask
from imaging.session.records import SplitRecord
from imaging.session.session import SPLIT, Session
from recon.data.dataset import View
from recon.data.light import radiance_image
from recon.data.load import load
from recon.decide.overrides import Overrides
from recon.decide.presets import QualityName
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.result.opened import open_model
from recon.start.plane_sweep import plane_sweep
from recon.train.devices.warm_up import warm_up

SETS = ("castle", "monstree", "banana", "brighton")
PRESETS: tuple[QualityName, ...] = ("draft", "standard", "best")
WIDTH = 400
FOLDS = 4
KINDS = "gained", "seen", "unseen", "ssim"


def fold_of(session: Path, fold: int, work: Path) -> Path:
    """A session of the same files whose split tests one view in `FOLDS`."""
    folder = work / f"{session.name}-fold-{fold}"
    if not (folder / SPLIT).is_file():
        shutil.rmtree(folder, ignore_errors=True)
        # Hard links, since a session refuses links that lead out of it.
        left_out = shutil.ignore_patterns("reconstructions", SPLIT)
        shutil.copytree(session, folder, ignore=left_out, copy_function=os.link)
        files = sorted(shot.file for shot in Session.open(session).shots("scene"))
        tested = tuple(files[fold::FOLDS])
        trained = tuple(file for file in files if file not in tested)
        split = SplitRecord(reason=f"fold {fold} of {FOLDS}", train=trained, test=tested)
        (folder / SPLIT).write_text(split.model_dump_json())
    return folder


@cache
def confirmed(session: Path) -> dict[str, Mask]:
    """Pixels [H, W] of each view whose depth the other photographs confirm."""
    dataset = load(session, max_width=WIDTH)
    images = [radiance_image(view) for view in dataset.views]
    points = dataset.points().xyz
    maps = plane_sweep(dataset.views, images, points[np.isfinite(points).all(1)], most=len(dataset.views))
    return {str(swept.view.id): _at(swept.trusted, swept.view) for swept in maps}


def _at(mask: Mask, view: View) -> Mask:
    rows = ((np.arange(view.lens.height) + 0.5) * mask.shape[0] / view.lens.height).astype(int)
    columns = ((np.arange(view.lens.width) + 0.5) * mask.shape[1] / view.lens.width).astype(int)
    return np.asarray(mask[np.ix_(rows, columns)])


def figures(view: View, true: Array, image: Array, confirmed_pixels: Mask) -> dict[str, float]:
    """dB after one gain a channel: of all pixels, of the confirmed and of the other ones, and SSIM."""
    factors = (image * true)[view.valid].sum(0) / np.maximum((image * image)[view.valid].sum(0), 1e-12)
    gained = (image * factors).clip(0, 1)

    def db(mask: Mask) -> float:
        return metrics.psnr(gained[mask], true[mask]) if mask.sum() > 100 else float("nan")

    similarity = metrics.ssim(image.clip(0, 1), true)
    assert similarity is not None, "views of this bench are larger than SSIM's window"
    return {
        "gained": db(view.valid),
        "seen": db(view.valid & confirmed_pixels),
        "unseen": db(view.valid & ~confirmed_pixels),
        "share": float(confirmed_pixels[view.valid].mean()),
        "ssim": similarity,
    }


def trained(
    session: Path, fold: int, work: Path, preset: QualityName, seed: int, gaussians: int | None = None
) -> dict[str, Any]:
    """Figures by view of one training; `seconds` of the processor, from the first file to the scene.

    gaussians: the most, set by hand; None: as rig decides.
    """
    warm_up(lambda message, done, total: None)
    overrides = Overrides(width=WIDTH, gaussians=gaussians)
    request = TrainingRequest(
        quality=preset, seed=seed, overrides=overrides, name=f"time-{preset}", replace=True
    )
    began = time.process_time()
    folder = reconstruct(fold_of(session, fold, work), request)
    seconds = time.process_time() - began
    opened, settings = open_model(folder), read_model(folder).settings
    observation, masks = opened.training.method.observation, confirmed(session)
    views = {}
    for view in opened.dataset.held_out:
        (shot,) = view.shots
        with torch.no_grad():
            image = observation.predict(opened.render(view.lens), view, shot.k).double().numpy()
        mask = masks.get(str(view.id), np.zeros_like(view.valid))
        views[str(view.id)] = figures(view, picture_of(view), np.asarray(image), mask)
    size = {"iterations": settings.iterations, "gaussians": settings.max_gaussians}
    return {"seconds": seconds, **size, "views": views}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set, preset, fold and seed."""
    cache, rows = Cache(options.work / "real-more-time.jsonl"), []
    sets = SETS[:1] if options.quick else options.sets
    for name, preset, fold, seed in product(sets, options.presets, range(FOLDS), range(options.seeds)):

        def made(
            name: str = name, fold: int = fold, preset: QualityName = preset, seed: int = seed
        ) -> dict[str, Any]:
            return trained(session_of(name, options.work), fold, options.work, preset, seed)

        what = {"set": name, "preset": preset, "fold": fold, "seed": seed}
        rows.append(what | cache.get(f"{name} {preset} fold {fold} seed {seed}", made))
    return {"machine": machine(), "rows": rows}


def by_view(result: dict[str, Any], name: str, preset: str) -> Array:
    """Figures of every view of a set, [views, (dB, confirmed, others, SSIM)], means over seeds."""
    of_views: dict[str, list[list[float]]] = {}
    for row in result["rows"]:
        if (row["set"], row["preset"]) == (name, preset):
            for view, kinds in row["views"].items():
                of_views.setdefault(view, []).append([kinds[kind] for kind in KINDS])
    return np.array([np.mean(of_views[view], axis=0) for view in sorted(of_views)])


def report(result: dict[str, Any]) -> str:
    """The table of presets by set, and what each preset adds to the draft, view by view."""
    tried = {(row["set"], row["preset"]): row for row in result["rows"]}
    seeds = 1 + max(row["seed"] for row in result["rows"])
    lines = [
        "# Real sets of few photographs: what more time buys",
        "",
        f"`python -m bench.real.more_time --write`: {WIDTH} px wide, no trials, seeds: {seeds}. "
        f"{words(result['machine'])}.",
        "",
        f"Every view is held out once, one in {FOLDS} at a time. Held-out dB after a gain a channel: of all "
        "pixels, of those whose depth another photograph confirms, and of the others; SSIM. Behind +-: the "
        "standard error over views of the difference to draft. Seconds are of the processor, from the first "
        "file to the scene, means over trainings.",
        "",
        "| set | views | preset | dB | confirmed | others | SSIM | iterations | Gaussians | processor s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for (name, preset), row in tried.items():
        views = by_view(result, name, preset)
        seconds = [r["seconds"] for r in result["rows"] if (r["set"], r["preset"]) == (name, preset)]
        db, shown, others, ssim = np.nanmean(views, axis=0)
        lines.append(
            f"| {name} | {len(views)} | {preset} | {db:.2f} | {shown:.2f} | {others:.2f} | {ssim:.3f} "
            f"| {row['iterations']:,} | {row['gaussians']:,} | {np.mean(seconds):.0f} |"
        )
    lines += [
        "",
        "## Gain over draft",
        "",
        "| set | preset | dB | confirmed | others | SSIM | views that lose |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, preset in tried:
        if preset == "draft":
            continue
        gain = by_view(result, name, preset) - by_view(result, name, "draft")
        mean = np.nanmean(gain, axis=0)
        error = np.nanstd(gain, axis=0, ddof=1) / np.sqrt(np.isfinite(gain).sum(axis=0))
        cells = [
            f"{m:+.{places}f} +- {e:.{places}f}"
            for m, e, places in zip(mean, error, (2, 2, 2, 3), strict=True)
        ]
        lines.append(f"| {name} | {preset} | {' | '.join(cells)} | {(gain[:, 0] < 0).sum()} of {len(gain)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", nargs="+", default=SETS)
    parser.add_argument("--presets", nargs="+", default=PRESETS)
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "real_more_time", result, report(result))


if __name__ == "__main__":
    main()
