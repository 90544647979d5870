"""Session and calibration to a scene: the whole stage, resumable."""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imaging.errors import InputError, ReconstructionError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.records import Rung
from recon.data.dataset import Dataset, load
from recon.data.light import light_of, radiance_image
from recon.decide.budget import Budget
from recon.decide.corrections import refinement_for
from recon.decide.countdown import Countdown
from recon.decide.method_choice import chosen_method, rungs
from recon.decide.overrides import Overrides
from recon.decide.prediction import Prediction, enough, predicted
from recon.decide.presets import QUALITIES, START_SHARE, MethodName, Quality, QualityName
from recon.decide.probe import FEWEST, has_time_for_trials, probe
from recon.decide.settings import Settings
from recon.decide.size import degree_for, fewer, most_for, size_for
from recon.decide.trials import no_trial
from recon.methods import hdr_gs, nh_3dgs
from recon.observe.refinement import Refinement
from recon.result.model import CHECKPOINT, LOG, MODEL, REFINEMENT
from recon.result.place import default_name, place_for
from recon.result.save import write_scene
from recon.scene.checkpoint import Checkpoint, write_checkpoint
from recon.splat import SplatStats
from recon.train.device import training_device
from recon.train.early_stopping import Deadline, EarlyStop, Goal
from recon.train.initialisation import gaussians_at, start_points
from recon.train.interrupt import Interrupted
from recon.train.ranks import Ranks, joined
from recon.train.resume import checkpoint_of, light_in, restored
from recon.train.trainer import train
from recon.train.training import Steer, Training
from recon.train.warm_up import warm_up

__all__ = ["QUALITIES", "START_SHARE", "MethodName", "Quality", "QualityName", "reconstruct"]

_AS_IT_IS = Overrides()


def reconstruct(
    session: str | Path,
    *,
    method: MethodName = "auto",
    quality: QualityName = "standard",
    budget: Budget | float | str | None = None,
    seed: int = 0,
    overrides: Overrides = _AS_IT_IS,
    name: str | None = None,
    replace: bool = False,
    shelf: str = "reconstructions",
    early_stop: bool = False,
    progress: Progress = unreported,
    tell: Callable[[str], None] = lambda line: None,
    clock: Callable[[], float] = time.monotonic,
    countdown: Countdown | None = None,
) -> Path:
    """Train a scene on a calibrated session; returns the folder SESSION/SHELF/NAME.

    budget: seconds, or a `Budget`, or what `Budget.parse` reads. A time is that from the call to the return,
    or what `countdown` says, whose time began before or ends later. The whole schedule is made shorter if the
    preset's iterations do not fit at the speed measured at the start, and again on the way if that was
    misjudged. What else has no room is left out as `recon.decide.countdown` says; where 50 iterations do not
    fit it ends with an InputError that says how long would do. overrides: what is not to be as the preset and
    the method have it. early_stop: train no longer than was worth it for other scenes, and end when held-out
    quality stands still. name: None names method, quality and budget (`default_name`). tell: hears what is
    predicted of a training with a budget, and what is left out. With early_stop or a budget in dB some of the
    held-out views are for that alone (`Dataset.with_validation`).

    A training that was stopped (Interrupted) leaves the scene as it was then, and goes on bit for bit when
    called again with the same settings (with a time to keep, as fast as the machine then is); a finished
    one is returned as it is. A training of other settings, or of another calibration, is not overwritten
    (InputError) unless `replace` says so; then the new one is trained in `SHELF/.NAME.new`, and takes the
    place of what is there when it is finished. Runs on the GPU if there is one. Started several times over
    by torchrun, the processes train one scene together, each looking at a share of the views: a step then
    takes as many views as there are processes, and there are fewer steps. The session has to be on a disk
    that all of them see; the first one writes. Errors: ReconstructionError, InputError,
    StorageError.
    """
    session = Path(session)
    if isinstance(budget, str):
        budget = Budget.parse(budget)
    elif budget is not None and not isinstance(budget, Budget):
        budget = Budget(budget, "s")
    if not 0 <= seed < 2**32:
        raise InputError(f"The seed {seed} is out of range: give a number from 0 to 4294967295.")
    if budget is not None and budget.unit == "s" and countdown is None:
        countdown = Countdown(budget.amount, clock(), clock=clock, say=tell)
    with joined() as ranks:
        preset, device = QUALITIES[quality], training_device()
        width = overrides.width or preset.width
        store.require_writable(session / shelf)
        dataset = overrides.subset(load(session, max_width=width, progress=progress))
        if budget is not None and budget.unit == "dB" and not dataset.held_out:
            raise ReconstructionError(
                f"{session} has too few views to hold one out, so a budget in dB cannot be told: give a time."
            )
        chosen, reasons = _method(dataset, method)
        gaussians = overrides.gaussians or preset.gaussians
        if budget is not None and budget.gaussians is not None:
            # More Gaussians than pixels cannot be told apart.
            pixels = sum(view.lens.width * view.lens.height for view in dataset.train)
            gaussians = min(budget.gaussians, pixels)
        wanted = Settings.model_validate(
            {
                "method": chosen,
                "quality": quality,
                "seed": seed,
                "iterations": math.ceil((overrides.iterations or preset.iterations) / ranks.count),
                "batch": ranks.count,
                "max_gaussians": gaussians,
                "max_width": width,
                "budget": None if budget is None else budget.amount,
                "budget_unit": "s" if budget is None else budget.unit,
                "early_stop": early_stop,
                "overrides": overrides,
            }
        )
        if wanted.watches:
            dataset = dataset.with_validation()
        folder = store.inside(session, f"{shelf}/{name or default_name(chosen, quality, budget)}")
        place, found = place_for(folder, wanted, dataset.calibration_sha256, replace)
        ladder = (*reasons, *rungs(dataset, chosen))
        _reconstruct(place, found, dataset, wanted, ladder, device, ranks, progress, tell, clock, countdown)
        if place != folder and ranks.first:
            store.replace_folder(place, folder)
        return folder


def _reconstruct(
    folder: Path,
    found: Checkpoint | None,
    dataset: Dataset,
    wanted: Settings,
    ladder: tuple[Rung, ...],
    device: torch.device,
    ranks: Ranks,
    progress: Progress,
    tell: Callable[[str], None],
    clock: Callable[[], float],
    countdown: Countdown | None,
) -> None:
    """`reconstruct` on one of the ranks: begin, or go on from what was found; train; write."""
    if found is None:
        begun = _begin(folder, dataset, wanted, device, ranks, progress, tell, clock, countdown)
        training, settings, size, guess = begun
    else:
        settings = Settings.model_validate(found.facts["settings"])
        told = found.facts["predicted"]
        guess = Prediction.model_validate(told) if told else None
        size = tuple(Rung.model_validate(rung) for rung in found.facts.get("size", []))
        composed = settings.composed(dataset, light_in(found))
        refinement = Refinement.stored(dataset, found)
        training = restored(composed, found, dataset.extent, device, refinement)
        if not ranks.first:  # the first one holds what all had counted
            training.stats = SplatStats(len(training.gaussians))
        if training.schedule and training.iteration >= training.schedule.total and (folder / MODEL).is_file():
            return
    steers: list[Steer] = [EarlyStop()] if wanted.early_stop else []
    if wanted.budget is not None and wanted.budget_unit == "dB":
        steers.append(Goal(wanted.budget))
    if countdown is not None:
        if found is not None:
            countdown.reserve = found.facts["reserve"]
        spent = training.seconds + training.measuring
        # What an earlier run trained before it was stopped is part of the time.
        limit = countdown.left() + (spent if found is None else 0.0)
        steers.append(Deadline(max(limit, 1e-3), _longest(wanted), settings.max_gaussians))
    saved, lines = [-1], _lines(folder, training, ranks)

    def log(line: dict[str, Any]) -> None:
        lines.append(line)
        store.append_line(folder / LOG, line)

    def save() -> None:
        facts = {
            "asked": wanted.model_dump(mode="json"),
            "settings": settings.model_dump(mode="json"),
            "size": [rung.model_dump(mode="json") for rung in size],
            "calibration_sha256": dataset.calibration_sha256,
            "reserve": 0.0 if countdown is None else countdown.reserve,
            "predicted": guess and guess.model_dump(mode="json"),
        }
        write_checkpoint(folder / CHECKPOINT, checkpoint_of(training, facts))
        saved[0] = training.iteration

    def write() -> None:
        loss = float(lines[-1]["loss"]) if lines else None
        write_scene(folder, dataset, training, settings, loss, (*ladder, *size), guess, progress)

    plan = settings.plan()
    try:
        train(
            training,
            dataset,
            plan,
            log=log,
            save=save,
            progress=progress,
            ranks=ranks,
            steers=steers,
            clock=clock,
        )
    except KeyboardInterrupt as error:
        if saved[0] != training.iteration:  # another rank, or what is there is not whole
            raise
        write()
        raise Interrupted(f"{folder} has the scene after {training.iteration} iterations") from error
    if ranks.first:
        save()
        write()


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


def _begin(
    folder: Path,
    dataset: Dataset,
    wanted: Settings,
    device: torch.device,
    ranks: Ranks,
    progress: Progress,
    tell: Callable[[str], None],
    clock: Callable[[], float],
    countdown: Countdown | None,
) -> tuple[Training, Settings, tuple[Rung, ...], Prediction | None]:
    """Gaussians at their start; what an earlier training left in the folder is removed.

    Trials count as training.
    """
    warm_up(progress, device, fisheye=any(view.lens.fisheye for view in dataset.views))
    started = clock()
    images = [radiance_image(view) for view in dataset.train]
    if countdown is not None:
        countdown.plan(ranks.told(clock() - started), len(dataset.train), len(dataset.held_out))
        countdown.require(ranks.told(clock() - started), FEWEST)
    light = light_of(dataset, images)
    rng = np.random.Generator(np.random.PCG64([wanted.seed, 0x57A27]))
    share = START_SHARE if wanted.overrides.growth is None else 1 - wanted.overrides.growth
    colour = degree_for(dataset, wanted, images, ranks)
    most = most_for(dataset, wanted, colour[0])
    # Several processes have to begin with the same points, whichever is slower.
    over = countdown.start_over() if countdown is not None and ranks.count == 1 else None
    points = start_points(dataset, images, int(share * most), rng, progress, over)
    if countdown is not None and points.left_out:
        few = f"{points.left_out} of {len(dataset.train)} views"
        tell(f"{countdown.seconds:g} s leave no room for the depths of {few}.")
    settings = wanted.model_copy(
        update={"max_gaussians": most, "degree": colour[0], "iterations": _longest(wanted)}
    )
    refined = Refinement.of(dataset, ())

    def training() -> Training:
        """With what is decided by then."""
        method = settings.composed(dataset, light)
        gaussians = gaussians_at(points, method.appearance, method.observation.units)
        refinement = Refinement.of(dataset, refined.parameters, refined.rungs)
        return Training.begin(method, light, gaussians, dataset.extent, device, refinement)

    guess, deciding = None, wanted
    if countdown is not None:
        unhurried = wanted.model_copy(update={"budget": None})
        if not no_trial(dataset, unhurried):
            if has_time_for_trials(
                training, dataset, settings.plan(), ranks.told(countdown.left()), ranks=ranks, clock=clock
            ):
                deciding = unhurried
            else:
                tell(f"{countdown.seconds:g} s leave no room for trials of what the scene needs.")
    refined = refinement_for(dataset, deciding, ranks, progress)
    size = size_for(dataset, deciding, colour, refined, points, ranks, progress, device)
    settings = settings.model_copy(update={"max_gaussians": size.gaussians, "degree": size.degree})
    points = fewer(points, int(share * size.gaussians), wanted.seed)
    if wanted.budget is not None:
        seconds = None if countdown is None else ranks.told(countdown.left())
        found = probe(
            training, dataset, settings.plan(), seconds, ranks=ranks, progress=progress, clock=clock
        )
        if countdown is not None:
            left = ranks.told(countdown.left())
            fitting = found.iterations_within(left)
            if fitting < min(FEWEST, _longest(wanted)):
                countdown.require(max(found.seconds_for(FEWEST), left + 1.0), FEWEST)
            settings = settings.model_copy(update={"iterations": min(_longest(wanted), fitting)})
        if found.db is not None:
            length = settings.iterations * settings.batch
            guess = predicted(found.db, found.iterations, length, timed=countdown is not None)
        if guess is not None and ranks.first:
            tell(f"predicted: held-out {guess.db:.1f} dB ({guess.low:.1f} to {guess.high:.1f})")
    if ranks.first:
        store.make_folder(folder)
        for name in (CHECKPOINT, LOG):
            store.discard(folder / name)
    begun = training()
    begun.seconds = clock() - started
    return begun, settings, size.rungs, guess


def _longest(wanted: Settings) -> int:
    """Iterations at most: as asked for, or with early stop those that are worth it."""
    if not wanted.early_stop:
        return wanted.iterations
    return math.ceil(enough(wanted.iterations * wanted.batch) / wanted.batch)


def _lines(folder: Path, training: Training, ranks: Ranks) -> list[dict[str, Any]]:
    """The log up to where the training is; what was said of an earlier state is removed."""
    if not ranks.first:
        return []
    for name in (MODEL, REFINEMENT, "metrics.json"):
        store.discard(folder / name)
    lines = [line for line in store.read_lines(folder / LOG) if line["iteration"] <= training.iteration]
    store.write_bytes(folder / LOG, b"")
    for line in lines:
        store.append_line(folder / LOG, line)
    return lines
