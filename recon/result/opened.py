"""A trained scene beside the photographs of its session, for measuring it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from imaging.arrays import Array32
from imaging.errors import ReconstructionError
from imaging.progress import Progress, unreported
from imaging.session.paths import session_of
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from recon.data.dataset import Dataset, View, photographs_sha256
from recon.data.load import read_views
from recon.observe.refinement import Refinement
from recon.result.model import CHECKPOINT, ModelRecord, read_model, read_own_calibration
from recon.result.scene import Scene, scene_of
from recon.scene.checkpoint import read_checkpoint
from recon.splat import SplatCamera
from recon.train.training import Training
from recon.train.training_checkpoint import light_in, restored


@dataclass(frozen=True, eq=False)
class Opened:
    """A scene with the photographs of its session, and the training that it came from.

    The views of the data set are as training corrected them.
    """

    scene: Scene
    dataset: Dataset
    training: Training

    @property
    def folder(self) -> Path:
        """The scene's."""
        return self.scene.folder

    @property
    def record(self) -> ModelRecord:
        """The scene's."""
        return self.scene.record

    def render(self, camera: SplatCamera) -> torch.Tensor:
        """Return what a camera of `dataset` sees, in scene units, without gradient: float32 [H, W, 3]."""
        return self.scene.drawn(camera)

    def radiance(self, view: View) -> Array32:
        """Linear radiance of a view of `dataset`, float32 [H, W, channels]."""
        return self.scene.render(view.name)

    def view(self, name: str) -> View:
        """Return the view of that name, `frame/camera`; ReconstructionError for an unknown one."""
        full_name = self.scene.view(name).name
        return next(view for view in self.dataset.views if view.name == full_name)


def open_model(folder: Path, progress: Progress = unreported, width: int | None = None) -> Opened:
    """Open a finished reconstruction with the photographs of its session, SESSION/reconstructions/NAME.

    They are read by the calibration that it was trained on, which it holds itself. width: at most that of the
    photographs, px; None: as it was trained. ReconstructionError if the folder is no reconstruction or in no
    session, or if the photographs are not those it was trained on.
    """
    record = read_model(folder)
    dataset = _dataset(folder, record, progress, width or record.settings.max_width)
    checkpoint = read_checkpoint(folder / CHECKPOINT)
    method = record.settings.composed(dataset, light_in(checkpoint))
    refinement = Refinement.stored(dataset, checkpoint)
    training = restored(method, checkpoint, dataset.extent, refinement=refinement)
    return Opened(scene_of(folder, record, checkpoint), refinement.corrected(), training)


def _dataset(folder: Path, record: ModelRecord, progress: Progress, width: int) -> Dataset:
    """The photographs of the scene's views, in the scene's parts."""
    place = session_of(folder)
    if place is None:
        raise ReconstructionError(
            f"{folder} is not in its session, whose photographs it is measured by: put it back as "
            f"SESSION/reconstructions/{folder.resolve().name}; `rig render` works without."
        )
    session = Session.open(place)
    shots = {shot.file: shot for shot in session.shots("scene")}
    wanted = [shot.file for view in record.views for shot in view.shots]
    chosen = [shots[file] for file in wanted if file in shots]
    _require_photographs(folder, session, chosen, len(wanted), record)
    groups = {view.id: [shots[shot.file] for shot in view.shots] for view in record.views}
    held_out = {view.id for view in record.views if view.use != "training"}
    calibration = read_own_calibration(folder)
    dataset = read_views(
        session,
        calibration,
        record.calibration_sha256,
        groups,
        held_out,
        record.world,
        max_width=width,
        progress=progress,
    )
    return replace(dataset, watched=frozenset(record.validation))


def _require_photographs(
    folder: Path, session: Session, shots: Sequence[ShotRecord], wanted: int, record: ModelRecord
) -> None:
    """ReconstructionError unless a session has the very photographs that a scene was trained on."""
    if len(shots) < wanted or photographs_sha256(shots) != record.photographs_sha256:
        raise ReconstructionError(
            f"{session.folder} does not have the photographs and masks that {folder} was trained on, those "
            f"of session {record.session}, so it cannot be measured: reconstruct again with --replace; "
            "`rig render` works without them."
        )
    for shot in shots:
        if not session.file(shot).is_file():
            raise ReconstructionError(
                f"{session.file(shot)} is missing, and {folder} is measured by the photographs of its "
                "session: restore them; `rig render` works without."
            )
