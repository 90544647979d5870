"""Session and calibration to a scene: the whole stage, resumable."""

import math
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from imaging import store
from imaging.errors import InputError, ReconstructionError
from imaging.records import Rung
from recon.budget import iterations_within
from recon.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from recon.dataset import Dataset, load
from recon.density import DensityRules
from recon.device import device_name, training_device
from recon.fixed import Fixed
from recon.ladder import chosen_method, rungs
from recon.methods import METHODS, hdr_gs, nh_3dgs
from recon.model import CHECKPOINT, LOG, MODEL, SPLATS, ModelRecord, Settings
from recon.pixels import Progress
from recon.ply import write_ply
from recon.radiance import light_of, radiance_image
from recon.ranks import Ranks, joined
from recon.splat import SplatStats
from recon.start import gaussians_at, start_points
from recon.trainer import Plan, Training, train
from recon.warm_up import warm_up

MethodName = Literal["auto", "nh-3dgs", "hdr-gs", "vanilla"]
QualityName = Literal["draft", "standard", "best"]


@dataclass(frozen=True)
class Quality:
    """A preset: how long, how many, how fine. bench/budget.py has the curve behind it."""

    iterations: int
    gaussians: int
    width: int


QUALITIES: dict[str, Quality] = {
    "draft": Quality(500, 20_000, 320),
    "standard": Quality(2000, 20_000, 640),
    "best": Quality(4000, 40_000, 1280),
}

START_SHARE = 0.5
"""Share of the largest number of Gaussians that training starts with; the rest grows where it is wrong."""
_AS_IT_IS = Fixed()


def reconstruct(
    session: Path,
    *,
    method: MethodName = "auto",
    quality: QualityName = "standard",
    budget: float | None = None,
    seed: int = 0,
    fixed: Fixed = _AS_IT_IS,
    name: str | None = None,
    shelf: str = "reconstructions",
    progress: Progress = lambda message, done, total: None,
) -> Path:
    """Train a scene on a calibrated session; returns the folder SESSION/SHELF/NAME.

    budget: most seconds of training; if the preset's iterations do not fit at the speed measured at the
    start, the whole schedule is made shorter. fixed: what is not to be as the preset and the method have
    it. name: the method's if None. A training that was stopped goes on
    bit for bit when called again with the same settings; a finished one is returned as it is; other
    settings replace it. Runs on the GPU if there is one. Started several times over by torchrun, the
    processes train one scene together, each looking at a share of the views: a step then takes as many
    views as there are processes, and there are fewer steps. The session has to be on a disk that all
    of them see; the first one writes. Errors: ReconstructionError, InputError, StorageError.
    """
    if budget is not None and not 0 < budget < float("inf"):
        raise InputError(f"A budget of {budget} s is no time to train: give one such as 90s or 5m.")
    if not 0 <= seed < 2**32:
        raise InputError(f"The seed {seed} is out of range: give a number from 0 to 4294967295.")
    with joined() as ranks:
        return _reconstruct(session, method, quality, budget, seed, fixed, name, shelf, progress, ranks)


def _reconstruct(
    session: Path,
    method: MethodName,
    quality: QualityName,
    budget: float | None,
    seed: int,
    fixed: Fixed,
    name: str | None,
    shelf: str,
    progress: Progress,
    ranks: Ranks,
) -> Path:
    """`reconstruct` on one of the ranks."""
    preset, device = QUALITIES[quality], training_device()
    width = fixed.width or preset.width
    dataset = fixed.seen(load(session, max_width=width, progress=progress))
    chosen, reasons = _method(dataset, method)
    wanted = Settings.model_validate(
        {
            "method": chosen,
            "quality": quality,
            "seed": seed,
            "iterations": math.ceil((fixed.iterations or preset.iterations) / ranks.count),
            "batch": ranks.count,
            "max_gaussians": fixed.gaussians or preset.gaussians,
            "max_width": width,
            "budget": budget,
            "fixed": fixed,
        }
    )
    folder = store.inside(session, f"{shelf}/{name or chosen}")
    found = _checkpoint(folder, wanted, dataset)
    if found is None:
        training, settings = _begin(folder, dataset, wanted, device, ranks, progress)
    else:
        settings = Settings.model_validate(found.facts["settings"])
        light = Training.light_in(found)
        composed = fixed.composed(METHODS[chosen](dataset, light))
        training = Training.restore(composed, found, dataset.extent, device)
        if not ranks.first:  # the first one holds what all had counted
            training.stats = SplatStats(len(training.gaussians))
        if training.iteration >= settings.iterations and (folder / MODEL).is_file():
            return folder
    loss = _train(folder, dataset, training, settings, ranks, progress)
    if ranks.first:
        _write(folder, dataset, training, settings, loss, (*reasons, *rungs(dataset, chosen)))
    return folder


def _method(dataset: Dataset, asked: MethodName) -> tuple[str, tuple[Rung, ...]]:
    if asked == "auto":
        return chosen_method(dataset)
    if asked == hdr_gs.NAME and dataset.kind != "ldr":
        raise ReconstructionError(
            f"{dataset.session} holds linear images, which have no tone curve to learn: use --method nh-3dgs."
        )
    if asked == nh_3dgs.NAME and dataset.kind == "ldr":
        raise ReconstructionError(
            f"{dataset.session} holds developed photographs, no linear light: use --method hdr-gs or vanilla."
        )
    return asked, (Rung(name="method", taken=True, reason="asked for"),)


def _checkpoint(folder: Path, wanted: Settings, dataset: Dataset) -> Checkpoint | None:
    """The checkpoint of a training with just these settings, on just this calibration; else None."""
    if not (folder / CHECKPOINT).is_file():
        return None
    checkpoint = read_checkpoint(folder / CHECKPOINT)
    stored = dict(checkpoint.facts["settings"])
    asked = wanted.model_dump(mode="json")
    if wanted.budget is not None:
        stored.pop("iterations"), asked.pop("iterations")
    same = stored == asked and checkpoint.facts["calibration_sha256"] == dataset.calibration_sha256
    return checkpoint if same else None


def _begin(
    folder: Path, dataset: Dataset, wanted: Settings, device: torch.device, ranks: Ranks, progress: Progress
) -> tuple[Training, Settings]:
    """Gaussians at their start; what an earlier training left in the folder is removed."""
    warm_up(progress, device)
    started = time.monotonic()
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    rng = np.random.Generator(np.random.PCG64([wanted.seed, 0x57A27]))
    share = START_SHARE if wanted.fixed.growth is None else 1 - wanted.fixed.growth
    points = start_points(dataset, images, int(share * wanted.max_gaussians), rng, progress)

    def training() -> Training:
        method = wanted.fixed.composed(METHODS[wanted.method](dataset, light))
        gaussians = gaussians_at(points, method.appearance, method.observation.units)
        return Training.begin(method, light, gaussians, dataset.extent, device)

    settings = wanted
    if wanted.budget is not None:
        left = wanted.budget - (time.monotonic() - started)
        fitting = iterations_within(left, training, dataset, wanted.max_gaussians, progress)
        fitting = int(ranks.told(fitting))
        settings = wanted.model_copy(update={"iterations": min(wanted.iterations, fitting)})
    if ranks.first:
        store.make_folder(folder)
        for name in (MODEL, CHECKPOINT, LOG, "metrics.json"):
            store.discard(folder / name)
    begun = training()
    begun.seconds = time.monotonic() - started
    return begun, settings


def _train(
    folder: Path,
    dataset: Dataset,
    training: Training,
    settings: Settings,
    ranks: Ranks,
    progress: Progress,
) -> float:
    """Train to the end, with a log and checkpoints; the last loss that was logged (NaN on other ranks)."""
    lines: list[dict[str, Any]] = []
    if ranks.first:
        lines = [line for line in store.read_lines(folder / LOG) if line["iteration"] <= training.iteration]
        store.write_bytes(folder / LOG, b"")
        for line in lines:
            store.append_line(folder / LOG, line)

    def log(line: dict[str, Any]) -> None:
        lines.append(line)
        store.append_line(folder / LOG, line)

    def save() -> None:
        facts = {
            "settings": settings.model_dump(mode="json"),
            "calibration_sha256": dataset.calibration_sha256,
        }
        write_checkpoint(folder / CHECKPOINT, training.checkpoint(facts))

    plan = Plan(settings.iterations, DensityRules(settings.max_gaussians), settings.seed, settings.batch)
    train(training, dataset, plan, log=log, save=save, progress=progress, ranks=ranks)
    if ranks.first:
        save()
    return float(lines[-1]["loss"]) if lines else math.nan


def _write(
    folder: Path,
    dataset: Dataset,
    training: Training,
    settings: Settings,
    loss: float,
    ladder: tuple[Rung, ...],
) -> None:
    """splats.ply, and last of all model.json, which says that everything is there."""
    light, appearance = training.light, training.method.appearance
    device = training.gaussians.parameters["means"].device
    ldr = dataset.kind == "ldr"
    gauge = "the calibration's response" if ldr else "camera signal = radiance x exposure scale"
    note = f"linear Rec.709 radiance over {light.normaliser:.6g} ({gauge}); not clipped, not tone-mapped"
    if settings.method == "vanilla" and ldr:
        note = "display values, sRGB, as 3DGS"
    write_ply(folder / SPLATS, training.gaussians.to(torch.device("cpu")), appearance, 1.0, note)
    record = ModelRecord(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "torch", "numpy", "numba")},
        settings=settings,
        calibration_sha256=dataset.calibration_sha256,
        normaliser=light.normaliser,
        reference=light.reference,
        radiance=f"relative to {gauge}",
        training_views=tuple(view.name for view in dataset.train),
        held_out=tuple(view.name for view in dataset.held_out),
        gaussians=len(training.gaussians),
        train_seconds=round(training.seconds, 3),
        device=device_name(device),
        loss=loss,
        rungs=ladder,
    )
    store.write_json(folder / MODEL, record.model_dump(mode="json"))
