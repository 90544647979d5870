"""Scene under training, for viewers in other processes.

A viewer requests a snapshot by a file in the scene's folder. Without a request none is made, so that a
training without viewers is not slowed down.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from imaging.errors import StorageError
from imaging.files import store
from imaging.record import parse
from recon.result.model import ModelRecord
from recon.result.scene import Scene, scene_of
from recon.scene.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from recon.scene.environment import NAME as ENVIRONMENT
from recon.train.training import Training

WANTED, SNAPSHOT = "live.wanted", "live.safetensors"
MOST_SHARE = 0.02
"""Share of the time of a training that its snapshots may take, but for the first, which determines their
exposure.
"""
LEAST_SECONDS, LOOK_SECONDS = 1.0, 0.2
"""Seconds between two snapshots, and between two checks for a request, which are slow on a disk far away."""


@dataclass
class Snapshots:
    """Snapshots of one training. record: the current record of it."""

    folder: Path
    training: Training
    record: Callable[[], ModelRecord]
    clock: Callable[[], float] = time.monotonic
    _next: float = field(default=0.0, init=False)
    _first: bool = field(default=True, init=False)

    def wanted(self) -> bool:
        """Return whether somebody asked for one, and it is time for it."""
        now = self.clock()
        if now < self._next:
            return False
        self._next = now + LOOK_SECONDS
        return (self.folder / WANTED).exists()

    def write(self) -> None:
        """Answer the question by the scene as it is; a disk that refuses is no reason to end a training."""
        began = self.clock()
        with suppress(StorageError):
            store.discard(self.folder / WANTED)
            write_checkpoint(self.folder / SNAPSHOT, self._checkpoint())
        now = self.clock()
        rest = 0.0 if self._first else (now - began) * (1 / MOST_SHARE - 1)
        self._first, self._next = False, now + max(LEAST_SECONDS, rest)

    def clear(self) -> None:
        """Remove question and answer: the training begins, or is over, however it ended."""
        with suppress(StorageError):
            for name in (WANTED, SNAPSHOT):
                store.discard(self.folder / name)

    def _checkpoint(self) -> Checkpoint:
        training = self.training
        assert training.schedule is not None
        parts = {f"gaussians.{name}": value for name, value in training.gaussians.parameters.items()}
        if training.environment is not None:
            far = training.environment.tensors()
            parts |= {f"{ENVIRONMENT}.{name}": value for name, value in far.items()}
        facts = {
            "record": self.record().model_dump(mode="json"),
            "total": training.schedule.total,
            "moment": vars(training.curve[-1]) if training.curve else None,
        }
        return Checkpoint(parts, facts)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """scene: as it was. total: iterations of the schedule. moment: iteration and dB of the last point of the
    live curve; None before there is one."""

    scene: Scene
    total: int
    moment: tuple[int, float] | None


def ask(folder: Path) -> None:
    """Ask the training in a folder for a snapshot; StorageError where nothing can be written there."""
    try:
        (folder / WANTED).touch()
    except OSError as error:
        raise store.refused(folder / WANTED, error) from error


def read_snapshot(folder: Path) -> Snapshot:
    """Read the last snapshot of the training in a folder; ReconstructionError without one."""
    path = folder / SNAPSHOT
    checkpoint = read_checkpoint(path)
    facts = checkpoint.facts
    record, moment = parse(ModelRecord, facts["record"], path), facts["moment"]
    return Snapshot(
        scene_of(folder, record, checkpoint),
        facts["total"],
        None if moment is None else (moment["iteration"], moment["db"]),
    )
