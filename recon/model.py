"""`model.json`: what was trained, from what, with which choices; and a trained scene opened again."""

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Literal

import torch

from imaging import store
from imaging.errors import ReconstructionError
from imaging.records import Record, Rung, parse
from recon.budget import Unit
from recon.checkpoint import read_checkpoint
from recon.dataset import Dataset, View, load
from recon.density import DensityRules
from recon.fixed import Fixed
from recon.haste import haste
from recon.method import Light, Method
from recon.methods import METHODS
from recon.refinement import Refinement
from recon.splat import SplatCamera
from recon.trainer import Plan, Training

MODEL = "model.json"
CHECKPOINT = "checkpoint.safetensors"
SPLATS = "splats.ply"
LOG = "train.jsonl"
REFINEMENT = "refinement.json"


class Settings(Record):
    """What decides a training besides the session: the same settings and seed give the same bytes."""

    method: Literal["nh-3dgs", "hdr-gs", "vanilla"]
    quality: Literal["draft", "standard", "best"]
    seed: int
    iterations: int
    """As planned at the start; a budget in seconds was turned into this number from the speed found then."""
    max_gaussians: int
    """As many at most as were asked for, or, of a training that was begun, as the scene was given."""
    max_width: int
    batch: int = 1
    """Views a step; as many as processes trained together."""
    budget: float | None = None
    """What was asked for, in `budget_unit`; None: the preset."""
    budget_unit: Unit = "s"
    early_stop: bool = False
    """Whether to train no longer than is worth it."""
    fixed: Fixed = Fixed()
    """What was set by hand."""
    degree: int | None = None
    """Of the harmonics, as the scene was given it; None: as `fixed` or the method has it."""

    @property
    def watches(self) -> bool:
        """Whether held-out views may end the training."""
        return self.early_stop or (self.budget is not None and self.budget_unit == "dB")

    def composed(self, dataset: Dataset, light: Light) -> Method:
        """The method with what was fixed and decided."""
        fixed = self.fixed if self.degree is None else self.fixed.model_copy(update={"degree": self.degree})
        return fixed.composed(METHODS[self.method](dataset, light))

    def plan(self) -> Plan:
        """The whole training."""
        return Plan(
            self.iterations,
            DensityRules(self.max_gaussians),
            self.seed,
            self.batch,
            measure=True,
            haste=haste(self.iterations * self.batch),
        )


class Prediction(Record):
    """Held-out quality foretold before training, dB: most likely, and an interval for 95 of 100 scenes."""

    db: float
    low: float
    high: float


class ModelRecord(Record):
    """`model.json`, written when the training is done."""

    schema_version: Literal[1] = 1
    created: datetime
    versions: dict[str, str]
    settings: Settings
    calibration_sha256: str
    """Of calibration.json as it was trained on; another value later means stale."""
    normaliser: float
    """Linear radiance, in the units of the calibration, that is 1 in scene units."""
    reference: float | None
    """The dimmest radiance that matters, in scene units."""
    radiance: str
    """What the radiance is relative to: the gauge."""
    training_views: tuple[str, ...]
    held_out: tuple[str, ...]
    validation: tuple[str, ...] = ()
    """Those of the held-out views that could end the training: figures of the others are of test views."""
    gaussians: int
    train_seconds: float
    device: str
    """The GPU's name, or how many threads of the CPU."""
    loss: float | None
    """The last that was logged; None if it was interrupted before there was any."""
    rungs: tuple[Rung, ...]
    iterations: int | None = None
    """Iterations done."""
    course: tuple[tuple[int, float], ...] = ()
    """The schedule as it came: straight lines through (iteration, position), which is up to
    `settings.iterations`. The same settings with this course give the same bytes on any machine."""
    ending: Literal["schedule", "early stop", "goal", "interrupted"] = "schedule"
    """Why it ended: as planned, since quality stood still, since it was reached, or since the user said so
    (the checkpoint can then be gone on with)."""
    held_out_db: float | None = None
    """The end of the live curve, of the validation views if there are any; None where no view is held out."""
    measuring_seconds: float = 0.0
    """What the live curve took, beside `train_seconds`."""
    predicted: Prediction | None = None
    """What was foretold of `held_out_db`."""


@dataclass(frozen=True)
class Opened:
    """A reconstruction with the session it belongs to."""

    folder: Path
    record: ModelRecord
    dataset: Dataset
    training: Training

    def render(self, camera: SplatCamera) -> torch.Tensor:
        """What a camera sees, in scene units, without gradient: float32 [H, W, 3]."""
        with torch.no_grad():
            degree = self.training.method.schedule.degree(1.0)
            return self.training.renderer()(self.training.gaussians, camera, degree=degree).image

    def view(self, name: str) -> View:
        """The view of that name, `frame/camera`; ReconstructionError if there is none."""
        for view in self.dataset.views:
            if view.name == name:
                return view
        raise ReconstructionError(
            f"{self.folder} has no view {name!r}: name one as {self.dataset.views[0].name}."
        )


def read_model(folder: Path) -> ModelRecord:
    """The model.json of a finished reconstruction; ReconstructionError if there is none."""
    path = folder / MODEL
    if not path.is_file():
        raise ReconstructionError(f"{folder} holds no finished reconstruction: run `rig reconstruct` first.")
    return parse(ModelRecord, store.read_json(path), path)


def open_model(folder: Path) -> Opened:
    """Open a finished reconstruction, SESSION/reconstructions/NAME.

    The views of its data set are as training corrected them. ReconstructionError if it is none, or if its
    session was calibrated anew since.
    """
    record = read_model(folder)
    fixed = record.settings.fixed
    dataset = fixed.seen(load(folder.resolve().parent.parent, max_width=record.settings.max_width))
    if dataset.calibration_sha256 != record.calibration_sha256:
        raise ReconstructionError(
            f"{dataset.session} was calibrated again since {folder}: reconstruct again."
        )
    checkpoint = read_checkpoint(folder / CHECKPOINT)
    method = record.settings.composed(dataset, Training.light_in(checkpoint))
    dataset = replace(dataset, watched=frozenset(record.validation))
    refinement = Refinement.stored(dataset, checkpoint)
    training = Training.restore(method, checkpoint, dataset.extent, refinement=refinement)
    return Opened(folder, record, refinement.corrected(), training)
