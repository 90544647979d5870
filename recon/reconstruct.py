"""Session and calibration to a scene: the whole stage, resumable."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from typing import Any

import torch

from imaging.arguments import checked
from imaging.compute.threads import one_thread_a_product
from imaging.errors import ReconstructionError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.lock import sole_maker
from imaging.session.records import Rung
from recon.data.dataset import Dataset
from recon.data.stated_factors import overruled
from recon.decide.cost.countdown import Countdown, TooShort
from recon.decide.cost.duration import slowdown
from recon.decide.cost.gpu_memory import exceeded, require_room
from recon.decide.cost.reader import Reader
from recon.decide.decisions import iterations_at_most, planned
from recon.decide.evidence import Run
from recon.decide.plan import TrainingPlan
from recon.decide.presets import QUALITIES
from recon.decide.request import TrainingRequest
from recon.decide.settings import Settings, asked_for
from recon.decide.steps.corrections import require_light
from recon.decide.steps.method_choice import method_for, rungs, uncoloured
from recon.observe.refinement import Refinement
from recon.result.folder import SceneFolder
from recon.result.model import CHECKPOINT, LOG, MODEL
from recon.result.training_folder import default_name, names_of, place_for
from recon.scene.checkpoint import Checkpoint
from recon.train.devices.gpu_check import trusted
from recon.train.devices.ranks import joined
from recon.train.devices.training_device import training_device
from recon.train.devices.warm_up import warm_up
from recon.train.early_stopping import Deadline, EarlyStop, Goal
from recon.train.interrupt import Interrupted
from recon.train.monitor import Hooks, Shown, no_viewer
from recon.train.trainer import train
from recon.train.training import Steer, Training
from recon.train.training_checkpoint import light_in, restored

_DEFAULTS = TrainingRequest()
_CPU = torch.device("cpu")


@one_thread_a_product()
@checked
def reconstruct(
    session: str | PathLike[str],
    request: TrainingRequest = _DEFAULTS,
    *,
    shelf: str = "reconstructions",
    on_progress: Progress = unreported,
    on_message: Callable[[str], None] = lambda line: None,
    on_log: Callable[[dict[str, Any]], None] = lambda line: None,
    clock: Callable[[], float] = time.monotonic,
    countdown: Countdown | None = None,
    **options: object,
) -> Path:
    """Train a scene on a calibrated session.

    A budget of time is that from the call to the return, or what `countdown` says, whose time began before or
    ends later. The whole schedule is made shorter if the preset's iterations do not fit at the speed measured
    at the start, and again on the way if that was misjudged. What else has no room is left out as
    `recon.decide.cost.countdown` says; where 50 iterations do not fit, the scene gets the width and the
    number of Gaussians of a smaller preset, unless both were set. With early stop or a budget in dB some of
    the held-out views are for that alone (`Dataset.with_validation`).

    A training that was stopped (Interrupted) leaves the scene as it was then, and goes on bit for bit when
    called again with the same request (with a time to keep, as fast as the machine then is); a finished one
    is returned as it is. A training of another request or calibration, or of other photographs or masks, is
    not overwritten unless it asks to replace that; then the new one is trained in `SHELF/.NAME.new`, and
    takes the place of what is there when it is finished. Runs on the GPU if there is one whose kernels are
    right. Started several times over by torchrun, the processes train one scene together, each looking at a
    share of the views: a step then takes as many views as there are processes, and there are fewer steps. The
    session has to be on a disk that all of them see; the first one writes.

    Args:
        session: Its folder.
        request: Options.
        shelf: Folder of the session that the scene lies in.
        on_progress: Callback for the current step, the steps done, and all of them.
        on_message: Callback for lines on predictions and on what is left out.
        on_log: Callback for each line of train.jsonl (iteration, loss, gaussians, seconds, held_out_db where
            it was measured), those from before a training was stopped too.
        clock: Seconds.
        countdown: Of a budget of time that began before this call.
        options: Options by name, in place of those of `request`.

    Returns:
        The folder SESSION/SHELF/NAME.

    Raises:
        ReconstructionError: The session cannot be trained.
        InputError: The scene exists with another request, or another process trains it, or a time has no
            room for the smallest training; the sentence says how long would do.
        StorageError: The disk refuses.
    """
    session = Path(session)
    quality, budget, overrides = request.quality, request.budget, request.overrides
    if budget is not None and budget.unit == "s" and countdown is None:
        countdown = Countdown(budget.amount, clock(), clock=clock, say=on_message)
    with joined() as ranks, ExitStack() as stack:
        # What takes seconds to refuse is refused before photographs are read.
        store.require_writable(session / shelf)
        there = any((session / shelf / name / MODEL).is_file() for name in names_of(request))
        reader = Reader(session, request, on_progress, on_message if ranks.first else lambda line: None)
        begins = ranks.first and (request.replace or not there)
        dataset = reader.read(overrides.width or QUALITIES[quality].width, begins=begins)
        if budget is not None and budget.unit == "dB":
            _require_held_out(dataset)
        if (missing := uncoloured(dataset)) and ranks.first:
            on_message(
                f"the colour of {', '.join(missing)} is not known: light stays camera RGB, unless a chart "
                "(rig calibrate --only colour --chart) gives a matrix."
            )
        require_light(dataset, request.method, overrides)
        # The name of the scene follows from the method, and its folder from the name.
        chosen, reasons = method_for(dataset, request.method)
        asked = asked_for(dataset, chosen, request, processes=ranks.count)
        name = request.name or default_name(chosen, quality, budget, all_views=request.all_views)
        folder = store.inside(session / shelf, name)  # the shelf may be a link to a larger disk
        # What is there decides where the training goes, so no other may begin until this one ends.
        ranks.decided(lambda: stack.enter_context(sole_maker(folder)))
        place, checkpoint = place_for(folder, asked, dataset, request.replace)
        device = _CPU if dataset.bands else training_device()  # the kernels of GPUs draw three channels
        device = trusted(device, on_message, on_progress, alone=ranks.count == 1)
        earlier = (*reasons, *rungs(dataset, chosen))
        for size, smaller in _sizes(asked, len(dataset.train), countdown, checkpoint):
            # A mosaic that is not twice as wide stays as it is.
            if any(view.lens.width > size.max_width for view in dataset.views) and size is not asked:
                dataset = reader.read(size.max_width)
            used = dataset.with_validation() if asked.watches else dataset
            run = Run(used, size, device, ranks, countdown, on_progress, on_message, clock, smaller=smaller)
            try:
                _reconstruct(place, run, asked, checkpoint, earlier, on_log)
                break
            except torch.OutOfMemoryError as error:
                raise exceeded(place, device, resumable=(place / CHECKPOINT).is_file()) from error
            except TooShort:
                if smaller is None:
                    raise
                assert countdown is not None
                instead = f"trained with {smaller.size} instead"
                line = f"{countdown.seconds:g} s leave no room for {size.size}: {instead}"
                if ranks.first:
                    on_message(f"{line}.")
                earlier = (*earlier, Rung(name="size of the preset", taken=False, reason=line))
        if place != folder and ranks.first:
            store.replace_folder(place, folder)
        return folder


def _sizes(
    asked: Settings, views: int, countdown: Countdown | None, checkpoint: Checkpoint | None
) -> Iterator[tuple[Settings, Settings | None]]:
    """Sizes of the training to try, each with the next smaller one, if any.

    A time may be too short for the preset: then each smaller one is tried, with its own width.
    """
    sizes = (asked,) if countdown is None else asked.downwards(views)
    if checkpoint is not None:  # it goes on at the size that it began with
        began = Settings.model_validate(checkpoint.facts["settings"]).max_width
        sizes = (asked if began == asked.max_width else asked.no_larger(began),)
    return zip(sizes, (*sizes[1:], None), strict=True)


def _require_held_out(dataset: Dataset) -> None:
    """ReconstructionError unless a held-out view can be measured, by which a budget in dB is judged."""
    if not dataset.held_out:
        raise ReconstructionError(
            f"{dataset.session} has too few views to hold one out and judge a budget in dB by it: give a "
            "time."
        )
    if all(view.hidden for view in dataset.held_out):
        raise ReconstructionError(
            f"Masks hide all held-out views of {dataset.session}, by which a budget in dB is judged: mend "
            "the masks, or give a time."
        )


def _reconstruct(
    folder: Path,
    run: Run,
    asked: Settings,
    checkpoint: Checkpoint | None,
    earlier: tuple[Rung, ...],
    on_log: Callable[[dict[str, Any]], None],
) -> None:
    """Run `reconstruct` on one of the ranks: begin, or go on from the checkpoint; train; write.

    asked: the key of this training in the checkpoint, whatever size the time had room for. earlier: rungs of
    the method, its image formation and larger sizes.
    """
    training, plan = _begun(folder, run, earlier) if checkpoint is None else _resumed(run, checkpoint)
    dataset = overruled(run.dataset, plan.settings.overruled).with_depths(plan.settings.depth_scale)
    run = dataclasses.replace(run, dataset=dataset)
    schedule = training.schedule
    if schedule and training.iteration >= schedule.total and (folder / MODEL).is_file():
        return
    if checkpoint is not None and run.countdown is not None:
        run.countdown.reserve = checkpoint.facts["reserve"]
    scene = SceneFolder(
        folder,
        run.dataset,
        training,
        asked,
        plan,
        reserve=0.0 if run.countdown is None else run.countdown.reserve,
        progress=run.progress,
        on_log=on_log,
    )
    if not run.ranks.first:
        _trained(scene, run, no_viewer, resumed=checkpoint is not None)
        return
    with scene.shown(run.clock) as shown:
        scene.go_on()
        _trained(scene, run, shown, resumed=checkpoint is not None)
        scene.save()
        scene.write()


def _trained(scene: SceneFolder, run: Run, shown: Shown, *, resumed: bool) -> None:
    """Train to the end; Interrupted, with the scene as it then is, where the user stops it."""
    training = scene.training
    try:
        train(
            training,
            run.dataset,
            scene.plan.settings.plan(),
            Hooks(
                log=scene.log,
                save=scene.save,
                progress=run.progress,
                steers=_steers(run, training, scene.plan.settings, resumed=resumed),
                shown=shown,
                clock=run.clock,
            ),
            ranks=run.ranks,
        )
    except KeyboardInterrupt as error:
        if scene.saved_at != training.iteration:  # another rank, or what is there is not whole
            raise
        scene.write()
        raise Interrupted(f"{scene.folder} has the scene after {training.iteration} iterations") from error


def _begun(folder: Path, run: Run, earlier: tuple[Rung, ...]) -> tuple[Training, TrainingPlan]:
    """Gaussians at their start; what an earlier training left in the folder is removed.

    Trials count as training.
    """
    views = run.dataset.views
    fisheye = any(view.lens.fisheye for view in views)
    deep = any(view.depth is not None for view in views)
    warm_up(run.progress, run.device, fisheye=fisheye, channels=views[0].channels, depth=deep)
    require_room(run.dataset, run.asked, run.device)
    started = run.clock()
    plan = run.ranks.decided(lambda: planned(run))
    plan = dataclasses.replace(plan, rungs=(*earlier, *plan.rungs))
    if run.ranks.first:
        store.make_folder(folder)
        for name in (CHECKPOINT, LOG):
            store.discard(folder / name)
    training = plan.training(overruled(run.dataset, plan.settings.overruled), run.device)
    training.seconds = run.clock() - started
    return training, plan


def _resumed(run: Run, checkpoint: Checkpoint) -> tuple[Training, TrainingPlan]:
    """The training that was stopped, with what was decided of it."""
    plan = TrainingPlan.stored(checkpoint.facts, light_in(checkpoint))
    dataset = overruled(run.dataset, plan.settings.overruled)
    refinement = Refinement.stored(dataset, checkpoint)
    method = plan.settings.composed(dataset, plan.light)
    training = restored(method, checkpoint, dataset.extent, run.device, refinement)
    if not run.ranks.first:  # the first one holds what all had counted
        training.count_anew()
    return training, plan


def _steers(run: Run, training: Training, settings: Settings, *, resumed: bool) -> list[Steer]:
    """Return what may make the training shorter on the way."""
    asked, cap = run.asked, settings.max_gaussians
    slower = slowdown(run.dataset.train, cap)
    steers: list[Steer] = [EarlyStop(halved=slower > 1)] if asked.early_stop else []
    if asked.budget is not None and asked.budget_unit == "dB":
        steers.append(Goal(asked.budget))
    if run.countdown is not None:
        # What an earlier run trained before it was stopped is part of the time.
        spent = training.seconds + training.measuring
        limit = run.countdown.remaining() + (0.0 if resumed else spent)
        steers.append(Deadline(max(limit, 1e-3), iterations_at_most(asked), cap, slowdown=slower))
    return steers
