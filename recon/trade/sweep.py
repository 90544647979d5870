"""The sweep: trainings one after the other, or several at once, within a budget, each kept when done."""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from os import PathLike
from pathlib import Path

from imaging.arguments import checked
from imaging.compute.workers import LocalWorkers, Task, Workers
from imaging.errors import ReconstructionError, RigError
from imaging.files import store
from imaging.progress import Progress, unreported
from recon.data.dataset import Dataset
from recon.data.holdout import FEWEST_FOR_HOLDOUT
from recon.decide.cost.memory_need import forecast
from recon.decide.presets import QUALITIES
from recon.decide.request import TrainingRequest
from recon.decide.steps.method_choice import chosen_method
from recon.measure.view_figures import has_figure
from recon.trade.point import OutOfTime, measuring, train_apart, train_point
from recon.trade.sweep_order import STANDARD, Session, expected_seconds, neighbours, planned
from recon.trade.trade_record import (
    FOLDER,
    TRADE,
    Choice,
    Measure,
    Point,
    Trade,
    code_hash,
    key_of,
    read_trade,
)
from recon.train.devices.training_device import gpus


@checked
def trade_sweep(
    session: str | PathLike[str],
    *,
    budget: float,
    workers: int | Workers = 1,
    seed: int = 0,
    on_progress: Progress = unreported,
    on_message: Callable[[str], None] = lambda line: None,
    until: float | None = None,
) -> Trade:
    """Train the most informative of a session's trade-offs, and write trade/trade.json.

    Each training is kept when it is done, so that a sweep that was stopped, or ran out of time, resumes when
    it is called again; a change of the photographs, their masks or depth maps, the calibration or the code
    begins anew. The scenes are the same, to the byte on machines of one kind.

    Args:
        session: Session, or its folder.
        budget: Seconds; the first training is begun however short they are.
        workers: Trainings at once, in processes of this machine, or where they run. Several on a machine have
            their own cores, and begin when the memory of their forecast is free; as they share the rest,
            their processor seconds are more comparable than their seconds.
        seed: Seed of the trainings.
        on_progress: Callback for the current step, the steps done, and all of them.
        on_message: Callback for lines that a person should read.
        until: Reading of `time.monotonic` at which the training under way is given up and no other is begun.

    Returns:
        All points of the trade-off, and the trainings that failed.

    Raises:
        InputError: The session cannot be used.
        ReconstructionError: Nothing could be trained.
        StorageError: The disk refuses.
    """
    session = Path(session)
    store.require_writable(session / FOLDER)
    width = max(preset.width for preset in QUALITIES.values())
    dataset = measuring(session, width, on_progress)
    if not dataset.held_out:
        raise ReconstructionError(
            f"{session} has too few views to hold one out, so nothing can be measured: take "
            f"{FEWEST_FOR_HOLDOUT} or more."
        )
    if not any(has_figure(dataset, view) for view in dataset.held_out):
        raise ReconstructionError(
            f"No held-out view of {session} can be measured, since masks hide all of it or no training view "
            "has its exposures: mend the masks, or name other test shots in split.json."
        )
    run = _Run(session, _begun(session, dataset, width, seed), Session.of(dataset), budget, until)
    if workers == 1:
        for choice in run.choices():
            run.alone(choice, on_progress, on_message)
    elif isinstance(workers, int):
        with closing(LocalWorkers(workers, gpus())) as several:
            _several(run, several, on_progress, on_message)
    else:
        _several(run, workers, on_progress, on_message)
    return run.finished()


@dataclass
class _Run:
    """A sweep under way."""

    session: Path
    trade: Trade
    limits: Session
    budget: float
    until: float | None
    began: float = field(default_factory=time.monotonic)
    tried: set[str] = field(default_factory=set)
    made: int = 0
    left_out: int = 0

    def choices(self) -> Iterator[Choice]:
        """Yield the next training, as long as there is time: the plan, then neighbours of the front.

        The first has to be done before the second is asked for: it determines the size of the others.
        """
        yield from self._fitting(planned(self.limits, None)[:1])
        standard = next((point for point in self.trade.points if point.choice == STANDARD), None)
        yield from self._fitting(planned(self.limits, standard))
        yield from self._fitting(neighbours(self.trade.points, self.limits))

    def _fitting(self, choices: Iterable[Choice]) -> Iterator[Choice]:
        for choice in choices:
            key = key_of(choice, self.trade)
            if key in self.tried or any(point.key == key for point in self.trade.points):
                continue
            needed = expected_seconds(choice, self.trade.points, self.limits)
            now = time.monotonic()
            spent = now - self.began
            over = self.until is not None and now >= self.until
            if over or (self.made and needed is not None and spent + needed > self.budget):
                self.left_out += 1
                continue
            self.tried.add(key)
            self.made += 1
            yield choice

    def alone(self, choice: Choice, progress: Progress, say: Callable[[str], None]) -> None:
        """Train in this process."""
        beside = self.beside(progress, choice)
        self.make(
            choice,
            lambda one: train_point(self.session, one, self.trade, progress=beside, until=self.until),
            say,
        )

    def begin(self, choice: Choice, workers: Workers) -> "Future[Point]":
        """Train when a worker has room for it."""
        ends = None if self.until is None else time.time() + self.until - time.monotonic()
        try:
            needed = forecast(
                self.session,
                workers.room,
                workers.cores,
                TrainingRequest(quality=choice.quality, overrides=choice.overrides),
            )
        except RigError as error:
            refused: Future[Point] = Future()
            refused.set_exception(error)
            return refused
        task = Task(needed, gpu=True)
        session = self.session.absolute()  # the working folder may be another one there
        return workers.submit(task, train_apart, session, choice, self.trade, workers.beside, ends)

    def make(self, choice: Choice, train: Callable[[Choice], Point], say: Callable[[str], None]) -> None:
        """Train and keep it, or note why that failed."""
        try:
            self.keep(train(choice), say)
        except OutOfTime:
            self.left_out += 1
            say(f"{label(choice)}: given up, since the time is over")
        except RigError as error:
            self.note(choice, error, say)

    def keep(self, point: Point, say: Callable[[str], None]) -> None:
        """A finished point, written at once."""
        self._write(points=(*self.trade.points, point))
        say(f"{label(point.choice)}: {point.db:.2f} dB in {point.seconds:.1f} s")

    def note(self, choice: Choice, error: RigError, say: Callable[[str], None]) -> None:
        """A training that cannot be made."""
        command = choice.command(str(self.session), self.trade.method, self.trade.seed)
        self._write(failed=self.trade.failed | {command: str(error)})
        say(f"{label(choice)}: {error}")

    def finished(self) -> Trade:
        """The trade-off, which says what the budget had no time for."""
        self._write(left_out=self.left_out)
        return self.trade

    def beside(self, progress: Progress, choice: Choice) -> Progress:
        """Progress of one training that says which one it is."""
        name = f"training {len(self.trade.points) + 1}, {label(choice)}"
        return lambda message, done, total: progress(f"{name}: {message}", done, total)

    def _write(self, **change: object) -> None:
        self.trade = self.trade.model_copy(update=change)
        store.make_folder(self.session / FOLDER)
        store.write_json(self.session / FOLDER / TRADE, self.trade.model_dump(mode="json"))


def _several(run: _Run, workers: Workers, progress: Progress, say: Callable[[str], None]) -> None:
    """Run as many at once as there are workers, but `standard` alone, since it determines the size of the
    others.
    """
    choices, under_way = run.choices(), dict[Future[Point], Choice]()
    while True:
        while len(under_way) < workers.at_once and STANDARD not in under_way.values():
            if (choice := next(choices, None)) is None:
                break
            under_way[run.begin(choice, workers)] = choice
        if not under_way:
            return
        done = len(run.trade.points)
        progress(f"{len(under_way)} under way, {done} done", 0, 0)
        for future in wait(under_way, return_when=FIRST_COMPLETED).done:
            run.make(under_way.pop(future), lambda choice, of=future: of.result(), say)  # type: ignore[misc]


def label(choice: Choice) -> str:
    """`standard`, or `iterations=500`."""
    words = choice.overrides.words()
    return ", ".join(words) if words else choice.quality


def _begun(session: Path, dataset: Dataset, width: int, seed: int) -> Trade:
    """The trade-off as it is so far, or an empty one."""
    kinds: dict[str, Measure] = {"ldr": "ldr_psnr_oe", "hdr": "hdr_psnr_mu"}
    trade = Trade(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "torch", "numpy", "numba")},
        code=code_hash(),
        calibration_sha256=dataset.calibration_sha256,
        photographs_sha256=dataset.photographs_sha256,
        depths_sha256=dataset.depths_sha256,
        method=chosen_method(dataset)[0],
        seed=seed,
        measure=kinds.get(dataset.kind, "raw_psnr"),
        width=width,
    )
    if not (session / FOLDER / TRADE).is_file():
        return trade
    before = read_trade(session)
    same = tuple(point for point in before.points if point.key == key_of(point.choice, trade))
    return trade.model_copy(update={"points": same})
