"""One point of a trade-off, trained as by `rig reconstruct`, measured and deleted; the front of several."""

import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from imaging.compute import threads
from imaging.compute.cores import available_cores
from imaging.compute.workers import Share, apart
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.calibration import read_calibration
from recon.data.dataset import Dataset
from recon.data.load import calibration_sha256, load
from recon.decide.request import TrainingRequest
from recon.measure.view_figures import measured
from recon.reconstruct import reconstruct
from recon.result.model import SPLATS
from recon.result.opened import open_model
from recon.trade.trade_record import FOLDER, Choice, Point, Trade, key_of
from recon.train.devices.training_device import training_device
from recon.train.devices.warm_up import warm_up


class OutOfTime(Exception):
    """A training was given up since its time was over."""


def train_apart(
    share: Share, session: Path, choice: Choice, trade: Trade, at_once: int, ends: float | None
) -> Point:
    """`train_point` in a process of its own, with its share of a machine.

    Args:
        share: Part of the machine that the process keeps to.
        session: Folder of a calibrated session.
        choice: What is trained.
        trade: Trade-off that the point belongs to: method, seed and size.
        at_once: Trainings that may share the machine with it, itself included.
        ends: Reading of `time.time`, which machines agree on, at which it is given up; None: never.

    Returns:
        The point.

    Raises:
        OutOfTime: The training was given up.
        WorkerLost: The process was killed at each attempt.
        RigError: The training fails, as by `recon.reconstruct.reconstruct`.
    """
    return apart(share, _work_on, session, choice, trade, at_once, ends)


def _work_on(session: Path, choice: Choice, trade: Trade, at_once: int, ends: float | None) -> Point:
    threads.set_threads(available_cores())  # of the share, which a process may learn late
    until = None if ends is None else time.monotonic() + ends - time.time()
    return train_point(session, choice, trade, at_once, until=until)


def train_point(
    session: Path,
    choice: Choice,
    trade: Trade,
    at_once: int = 1,
    progress: Progress = unreported,
    until: float | None = None,
) -> Point:
    """Train a choice and measure it at the trade's own size; what was trained is removed.

    Args:
        session: Folder of a calibrated session.
        choice: What is trained.
        trade: Trade-off that the point belongs to: method, seed and size.
        at_once: Trainings that may share the machine with it, itself included.
        progress: Callback for the current step, the steps done, and all of them.
        until: Reading of `time.monotonic` at which it is given up; None: never.

    Returns:
        The point: its size, its cost, and the quality of the held-out views.

    Raises:
        OutOfTime: The training was given up.
        RigError: The training fails, as by `recon.reconstruct.reconstruct`.
    """

    def watched(message: str, done: int, total: int) -> None:
        if until is not None and time.monotonic() > until:
            raise OutOfTime
        progress(message, done, total)

    key = key_of(choice, trade)
    name = f"point-{key}"
    folder = session / FOLDER / name
    if folder.exists():  # what a killed sweep left, whose processor time is unknown
        shutil.rmtree(folder)
    dataset = measuring(session, trade.width)
    # Kernels are compiled before the clock runs: it is training that is compared.
    warm_up(watched, training_device())
    try:
        used = time.process_time()
        reconstruct(
            session,
            TrainingRequest(
                method=trade.method,  # type: ignore[arg-type]
                quality=choice.quality,
                seed=trade.seed,
                overrides=choice.overrides,
                name=name,
            ),
            shelf=FOLDER,
            on_progress=watched,
        )
        used = time.process_time() - used
        opened = open_model(folder)
        corrected = opened.training.refinement
        _, _, rows, _ = measured(replace(opened, dataset=dataset))
        by_view = quality_of(rows)
        truth = [row["hdr_psnr_mu_aligned"] for row in rows if "hdr_psnr_mu_aligned" in row]
        return Point(
            key=key,
            choice=choice,
            command=choice.command(str(session), trade.method, trade.seed),
            iterations=opened.training.iteration,
            gaussians=len(opened.training.gaussians),
            degree=opened.training.method.degree(1.0),
            refine="+".join(corrected.parameters) or None if corrected is not None else None,
            width=max(view.lens.width for view in opened.dataset.views),
            device=opened.record.device,
            seconds=opened.record.train_seconds,
            processor_seconds=round(used, 3),
            at_once=at_once,
            size_bytes=(folder / SPLATS).stat().st_size,
            splats_sha256=store.sha256(folder / SPLATS),
            db=float(np.mean(list(by_view.values()))),
            views=by_view,
            truth_db=float(np.mean(truth)) if truth else None,
        )
    finally:  # its scene can be made again by its command
        shutil.rmtree(folder, ignore_errors=True)


_MEASURES = ("raw_psnr", "ldr_psnr_oe", "hdr_psnr_mu")


def quality_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """Quality of held-out views by name, dB; without those that have no figure, as where a mask hides all.

    Views of a mixed rig are each measured as their camera is. rows: as `recon.measure.view_figures.measured`
    returns them.
    """
    return {
        row["view"]: next(row[key] for key in _MEASURES if key in row)
        for row in rows
        if not row.keys().isdisjoint(_MEASURES)
    }


def measuring(session: Path, width: int, progress: Progress = unreported) -> Dataset:
    """The data set that all points of a session are measured on, read once a process."""
    read_calibration(session)  # a session without one is refused
    shots = store.sha256(session / "shots.jsonl")
    measured_before = _cache(session, width, calibration_sha256(session), shots)
    if not measured_before:
        measured_before.append(load(session, max_width=width, progress=progress))
    return measured_before[0]


@lru_cache(maxsize=1)
def _cache(session: Path, width: int, calibration: str, shots: str) -> list[Dataset]:
    return []


T = TypeVar("T")


def front(points: Sequence[T], cost: Callable[[T], float], gain: Callable[[T], float]) -> list[T]:
    """The points for which no other costs no more and gains as much or more, by rising cost."""
    best: list[T] = []
    for point in sorted(points, key=lambda item: (cost(item), -gain(item))):
        if not best or gain(point) > gain(best[-1]):
            best.append(point)
    return best


def behind(points: Sequence[T], cost: Callable[[T], float], gain: Callable[[T], float], point: T) -> float:
    """Return how much less a point gains than the best of those that cost no more; 0 on the front."""
    return max(gain(other) for other in points if cost(other) <= cost(point)) - gain(point)
