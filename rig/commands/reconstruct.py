"""`rig reconstruct`: train a scene."""

import time
from contextlib import ExitStack, closing
from dataclasses import replace as changed
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from imaging.session import session as sessions
from recon import reconstruct as reconstructing
from recon.data import pixels
from recon.decide import overrides
from recon.decide.cost import budget as budgets
from recon.decide.cost import countdown as countdowns
from recon.decide.cost import prediction
from recon.decide.presets import OVERRIDES
from recon.decide.request import TrainingRequest
from recon.result import model as models
from recon.train import interrupt
from rig.commands.evaluate import evaluated_before, run_evaluate
from rig.options.common import JsonOption, SessionArgument
from rig.options.common import budget as parsed_budget
from rig.options.request import Asked, Shown
from rig.report import tensorboard as events_log
from rig.terminal.failures import Stopped
from rig.terminal.progress import StatusLine, is_main_process
from rig.terminal.result import CommandResult, running
from rig.terminal.start_time import started_at
from rig.terminal.text import command_line, duration

REPORT_SHARE = 0.25
"""Share of the time of a training after which the report reads no more photographs."""
OPTIONS = Asked(
    budget=Shown(
        kind=str | None,
        made=lambda text: budgets.Budget.parse(text),
        how={"parser": parsed_budget, "metavar": "AMOUNT"},
    ),
    seed=Shown(how={"min": 0, "metavar": "N"}),
    overrides=Shown(
        "--set",
        list[str] | None,
        lambda words: overrides.Overrides.of(words),
        f"Fix one of {', '.join(OVERRIDES)}; may be repeated. rig trade measures what each of them buys.",
        {"metavar": "KEY=VALUE"},
    ),
)


def reconstruct(
    session: SessionArgument,
    request: Annotated[TrainingRequest, OPTIONS],
    tensorboard: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Log for TensorBoard into this folder: loss, held-out dB, Gaussians and seconds as they "
            "come, and held-out views in the end.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> CommandResult:
    """Train a scene on a calibrated session.

    Trains Gaussians, measures them on held-out views and writes a report. Ctrl-C saves the scene trained
    so far; the same command continues from there. A finished scene is never overwritten without --replace.
    Its folder is enough for rendering. Runs on the GPU if there is one. With several GPUs or
    machines, `torchrun ... -m rig reconstruct S` trains on all of them together.

    Example: rig reconstruct S --budget 5m
    """
    with running("reconstruct") as status, ExitStack() as stack:
        sessions.Session.open(session)  # refuses other folders before the stage is loaded
        events = None
        if tensorboard is not None and is_main_process():
            events = stack.enter_context(closing(events_log.TensorBoardLog(tensorboard)))
        with pixels.decoded_once():
            return run_reconstruct(session, status, request, events)


def run_reconstruct(
    session: Path,
    status: StatusLine,
    request: TrainingRequest,
    events: "events_log.TensorBoardLog | None" = None,
) -> CommandResult:
    """Train, evaluate, write the report and say what came of it."""
    budget, countdown = request.budget, None
    if budget is not None and budget.unit == "s":
        countdown = countdowns.Countdown(budget.amount, started_at(), page=True, say=status.say)
    trained = run_training(session, status, request, countdown=countdown, events=events)
    if countdown is not None and not countdown.page:
        return trained
    if not is_main_process():
        return CommandResult({}, [])
    folder = Path(trained.data["reconstruction"])
    shows = f"Next: {command_line('rig', 'render', folder)}"
    evaluated = evaluated_before(folder) if trained.already_there else None
    if evaluated is None:
        status.say(f"{shows}; the scene is there, its report follows")
        until = time.monotonic() + REPORT_SHARE * trained.data["train_seconds"]
        evaluated = run_evaluate(folder, status, until=until)
    if events is not None:
        events.finished(folder, logged=not trained.already_there)
    return changed(
        evaluated,
        data=trained.data | evaluated.data,
        lines=[
            *trained.lines,
            *evaluated.lines,
            shows,
        ],
        missing=evaluated.missing or trained.missing,
    )


def run_training(
    session: Path,
    status: StatusLine,
    request: TrainingRequest,
    *,
    countdown: "countdowns.Countdown | None" = None,
    events: "events_log.TensorBoardLog | None" = None,
) -> CommandResult:
    """Train a scene, or go on with it; a finished one is left as it is."""
    began = datetime.now(UTC)
    try:
        folder = reconstructing.reconstruct(
            session,
            request,
            on_progress=status,
            on_message=status.say,
            countdown=countdown,
            on_log=events.line if events is not None else lambda line: None,
        )
    except interrupt.Interrupted as error:
        raise Stopped(f"stopped; {error}; run the same command again to continue.") from error
    if not is_main_process():
        return CommandResult({"reconstruction": str(folder)})
    record = models.read_model(folder)
    there = record.created < began
    data: dict[str, Any] = {"reconstruction": str(folder), "device": record.device, "already_there": there}
    data |= record.model_dump(
        mode="json", include={"iterations", "train_seconds", "ending", "held_out_db", "predicted"}
    )
    data["width"] = record.width
    lines = [f"{folder}: {_outcome(record)}"]
    if there:
        when = record.created.astimezone().strftime("%Y-%m-%d %H:%M")
        lines = [f"{folder}: already there, finished on {when}: {_outcome(record)}"]
    if any(record.offset):
        data["offset"] = record.offset
        lines.append(
            "coordinates in its PLY files are less by {:.10g} {:.10g} {:.10g}, which single precision "
            "would not hold; model.json and their headers say so".format(*record.offset)
        )
    return CommandResult(data, lines, missing=_missing(record), already_there=there)


def _outcome(record: "models.ModelRecord") -> str:
    """Course of the training, in one line."""
    words = f"trained in {duration(record.train_seconds)} on {record.device}, {record.iterations} iterations"
    if record.ending == "early stop":
        words += f" of {record.settings.iterations} since validation views hardly got better"
    if record.held_out_db is None:
        return words
    words += f", {'validation' if record.validation else 'held-out'} {record.held_out_db:.1f} dB"
    words += f" at {record.width} px"
    if record.predicted is None:
        return words

    guess = record.predicted
    words = f"{words} (predicted {guess.db:.1f}, {guess.low:.1f} to {guess.high:.1f}"
    count = record.iterations * record.settings.batch
    other = prediction.corrected(guess, count) if record.ending == "schedule" else None
    if other is not None:
        words += f", for {guess.iterations} iterations; for the {count} that the time had room for "
        words += f"{other.db:.1f}, {other.low:.1f} to {other.high:.1f}"
    return f"{words})"


def _missing(record: "models.ModelRecord") -> str | None:
    """One sentence if a quality was asked for and not reached."""
    settings, reached = record.settings, record.held_out_db
    if settings.budget is None or settings.budget_unit != "dB" or reached is None:
        return None
    if reached >= settings.budget:
        return None
    return (
        f"Validation views reached {reached:.1f} dB at {record.width} px, not {settings.budget:g} dB: use a "
        "finer --quality or take more shots."
    )
