"""The folder of a scene while it is trained: its log, its checkpoint, and in the end the scene."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imaging.files import store
from imaging.progress import Progress
from imaging.session.lock import held
from recon.data.dataset import Dataset
from recon.decide.plan import TrainingPlan
from recon.decide.settings import Settings
from recon.result.display import exposure_of
from recon.result.live_scene import Snapshots
from recon.result.model import CHECKPOINT, LOG, MODEL, REFINEMENT, ModelRecord
from recon.result.save import as_corrected, record_of, write_scene
from recon.scene.checkpoint import write_checkpoint
from recon.train.training import Training
from recon.train.training_checkpoint import checkpoint_of


@dataclass
class SceneFolder:
    """Folder that one training writes.

    asked, plan: the training as asked for, and as decided. reserve: seconds that a budget of time keeps for
    what follows training. on_log: callback for each line of the log. saved_at: the iteration of the
    checkpoint; None until there is one. exposure: of the snapshots, so that they can be compared; None before
    the first.
    """

    folder: Path
    dataset: Dataset
    training: Training
    asked: Settings
    plan: TrainingPlan
    reserve: float
    progress: Progress
    on_log: Callable[[dict[str, Any]], None]
    saved_at: int | None = None
    exposure: float | None = None
    _lines: list[dict[str, Any]] = field(default_factory=list, init=False)

    def go_on(self) -> None:
        """Keep the log up to where the training is; remove what describes an earlier state."""
        for name in (MODEL, REFINEMENT, "metrics.json"):
            store.discard(self.folder / name)
        before = store.read_lines(self.folder / LOG)
        store.write_bytes(self.folder / LOG, b"")
        for line in before:
            if line["iteration"] <= self.training.iteration:
                self.log(line)

    def log(self, line: dict[str, Any]) -> None:
        """Add a line to the log."""
        self._lines.append(line)
        self.on_log(line)
        store.append_line(self.folder / LOG, line)

    def save(self) -> None:
        """Write the checkpoint that the training can go on from."""
        facts = {
            "asked": self.asked.model_dump(mode="json"),
            **self.plan.facts(),
            "calibration_sha256": self.dataset.calibration_sha256,
            "photographs_sha256": self.dataset.photographs_sha256,
            "depths_sha256": self.dataset.depths_sha256,
            "reserve": self.reserve,
        }
        write_checkpoint(self.folder / CHECKPOINT, checkpoint_of(self.training, facts))
        self.saved_at = self.training.iteration

    def write(self) -> None:
        """Write the scene as it is now, model.json last."""
        write_scene(self.folder, self.dataset, self.training, self.plan, self._loss, self.progress)

    @contextmanager
    def shown(self, clock: Callable[[], float]) -> Iterator[Snapshots]:
        """Publish the running training to other processes within the block."""
        snapshots = Snapshots(self.folder, self.training, self._record, clock)
        with held(self.folder):
            snapshots.clear()
            try:
                yield snapshots
            finally:
                snapshots.clear()

    def _record(self) -> ModelRecord:
        training = self.training
        assert training.schedule is not None
        if self.exposure is None:
            self.exposure = exposure_of(training, as_corrected(self.dataset, training.refinement))
        degree = training.method.degree(training.schedule.progress(training.iteration))
        return record_of(
            self.dataset, training, self.plan, self._loss, self.exposure, degree, display_db=None
        )

    @property
    def _loss(self) -> float | None:
        return float(self._lines[-1]["loss"]) if self._lines else None
