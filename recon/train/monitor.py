"""Monitoring of a training between two iterations: measuring, logging, steering and saving."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from imaging.progress import Progress, unreported
from recon.data.dataset import View
from recon.train.devices.ranks import Ranks
from recon.train.finite_losses import FiniteLosses
from recon.train.interrupt import Interrupt
from recon.train.live_curve import Moment, chosen_views, period
from recon.train.schedule import Schedule
from recon.train.training import Plan, Steer, Training


class Shown(Protocol):
    """A live viewer of a running training."""

    def wanted(self) -> bool:
        """Return whether somebody wants to see it now."""
        ...

    def write(self) -> None:
        """Show it."""
        ...


class _NoViewer:
    def wanted(self) -> bool:
        return False

    def write(self) -> None:
        """Do nothing: there is no viewer."""


no_viewer = _NoViewer()


def _unsaved() -> None:
    """Save nothing."""


def _unlogged(line: dict[str, Any]) -> None:
    """Log nothing."""


@dataclass(frozen=True)
class Hooks:
    """Callbacks of a training; of several ranks, those of the first one are called.

    Attributes:
        log: Takes a line of train.jsonl.
        save: Writes a checkpoint, every `Plan.checkpoint_seconds` and when the user interrupts.
        progress: Callback for the current step, the steps done, and all of them.
        steers: May shorten the rest of the schedule; the first that returns a number wins, and
            `Training.schedule` says what came of it.
        shown: Viewer that is asked after each iteration whether somebody wants to see the scene.
        clock: Seconds.
    """

    log: Callable[[dict[str, Any]], None] = _unlogged
    save: Callable[[], None] = _unsaved
    progress: Progress = unreported
    steers: Sequence[Steer] = ()
    shown: Shown = no_viewer
    clock: Callable[[], float] = time.monotonic


@dataclass
class Monitor:
    """Monitor of a training after each iteration.

    held_out: views that the live curve may be of. interrupt: whether the user asked to stop.
    losses: of single views, which have to be finite before anything is measured or saved.
    """

    training: Training
    schedule: Schedule
    plan: Plan
    held_out: Sequence[View]
    hooks: Hooks
    ranks: Ranks
    interrupt: Interrupt
    losses: FiniteLosses
    _losses: list[Tensor] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._measured_views = chosen_views(self.held_out) if self.plan.measure else ()
        self._period = period(self.plan.iterations, len(self._measured_views))
        self._started = self.hooks.clock() - self.training.seconds - self.training.measuring
        self._saved = self.hooks.clock()

    def after(self, loss: Tensor) -> Schedule:
        """Monitor the training after an iteration of this loss; return the schedule of the next ones.

        loss: a scalar, float64, on any device; it is read when it is logged.
        KeyboardInterrupt, after it is saved, where the user asked to stop.
        """
        training = self.training
        self._losses.append(loss)
        training.seconds = self.hooks.clock() - self._started - training.measuring
        last = training.iteration == self.schedule.total
        measured = bool(self._measured_views) and (last or training.iteration % self._period == 0)
        if measured:
            self.losses.require()
            self._measure()
        if measured or last or training.iteration % self.plan.log_every == 0:
            self._report(measured)
        wish = self._wish() if self.ranks.first and not last else 0
        due = self.ranks.first and self.hooks.clock() - self._saved > self.plan.checkpoint_seconds
        stop, late, rest = self.ranks.totals(self.interrupt.asked, due, wish)
        if rest:
            self.schedule = training.schedule = self.schedule.turned(training.iteration, int(rest))
        if stop or late:
            self.losses.require()
            training.gather(self.ranks, self.ranks.first)
            if self.ranks.first:
                self.hooks.save()
            self._saved = self.hooks.clock()
        if stop:
            raise KeyboardInterrupt
        if self.ranks.first and self.hooks.shown.wanted():
            self.losses.require()
            self.hooks.shown.write()
        return self.schedule

    def _measure(self) -> None:
        training, progress = self.training, self.schedule.progress(self.training.iteration)
        quality = training.held_out_psnr(self._measured_views, progress, self.ranks)
        training.curve.append(Moment(training.iteration, training.seconds, quality))
        training.measuring = self.hooks.clock() - self._started - training.seconds

    def _report(self, measured: bool) -> None:
        """Write a line of the log, and report the progress."""
        self.losses.require()
        training = self.training
        (loss,) = self.ranks.totals(float(np.mean(torch.stack(self._losses).tolist())))
        self._losses = []
        if not self.ranks.first:
            return
        line = {
            "iteration": training.iteration,
            "loss": loss,
            "gaussians": len(training.gaussians),
            "seconds": round(training.seconds, 3),
        }
        self.hooks.log(line | ({"held_out_db": round(training.curve[-1].db, 4)} if measured else {}))
        # Along the schedule as it was planned: its iterations change with every turn, its length never does.
        place = self.schedule.position(training.iteration)
        self.hooks.progress(self._state(loss), round(place), self.schedule.planned)

    def _wish(self) -> int:
        """Return what the first of the steers that wants a change wants; 0: none does."""
        wishes = (steer(self.training) for steer in self.hooks.steers)
        return next((wish for wish in wishes if wish is not None), 0)

    def _state(self, loss: float) -> str:
        """Return how it goes, in few words; a narrow terminal cuts off the last ones."""
        training, held_out = self.training, ""
        speed = training.iteration / max(training.seconds, 1e-9)
        if training.curve:
            width = max(view.lens.width for view in self._measured_views)
            held_out = f"held-out {training.curve[-1].db:.1f} dB at {width} px, "
        return f"{held_out}loss {loss:.4f}, {speed:.1f} it/s"
