"""What a training leaves behind: the scene, and what is to be said of it."""

from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import torch

from imaging import store
from imaging.records import Rung
from recon.dataset import Dataset
from recon.device import device_name
from recon.model import MODEL, REFINEMENT, SPLATS, ModelRecord, Prediction, Settings
from recon.ply import write_ply
from recon.prediction import ENOUGH, enough
from recon.presets import QUALITIES
from recon.trainer import Training


def write_scene(
    folder: Path,
    dataset: Dataset,
    training: Training,
    settings: Settings,
    loss: float | None,
    ladder: tuple[Rung, ...],
    predicted: Prediction | None,
) -> None:
    """splats.ply, refinement.json of what was corrected, and last model.json: all is there then."""
    light, appearance = training.light, training.method.appearance
    device = training.gaussians.parameters["means"].device
    ldr = dataset.kind == "ldr"
    gauge = "the calibration's response" if ldr else "camera signal = radiance x exposure scale"
    note = f"linear Rec.709 radiance over {light.normaliser:.6g} ({gauge}); not clipped, not tone-mapped"
    if settings.method == "vanilla" and ldr:
        note = "display values, sRGB, as 3DGS"
    degree = training.method.schedule.degree(1.0)
    write_ply(folder / SPLATS, training.gaussians.to(torch.device("cpu")), appearance, degree, 1.0, note)
    if training.refinement is not None and training.refinement.parameters:
        store.write_json(folder / REFINEMENT, training.refinement.facts())
    why = () if training.refinement is None else training.refinement.told()
    course = training.course
    assert course is not None
    interrupted = training.iteration < course.total
    record = ModelRecord(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "torch", "numpy", "numba")},
        settings=settings,
        calibration_sha256=dataset.calibration_sha256,
        normaliser=light.normaliser,
        reference=light.reference,
        radiance=f"relative to {gauge}",
        training_views=tuple(view.name for view in dataset.train),
        held_out=tuple(view.name for view in dataset.held_out),
        validation=tuple(view.name for view in dataset.validation),
        gaussians=len(training.gaussians),
        train_seconds=round(training.seconds, 3),
        measuring_seconds=round(training.measuring, 3),
        device=device_name(device),
        loss=loss,
        iterations=training.iteration,
        course=course.turns,
        ending="interrupted" if interrupted else training.ending or "schedule",
        held_out_db=training.curve[-1].db if training.curve else None,
        predicted=predicted,
        rungs=(*ladder, *why, *_early_stop(training, settings)),
    )
    store.write_json(folder / MODEL, record.model_dump(mode="json"))


def _early_stop(training: Training, settings: Settings) -> tuple[Rung, ...]:
    """Whether the training was made shorter, before it or on the way; nothing where nobody looked."""
    if not settings.early_stop:
        return ()
    cut, turns = training.ending == "early stop", training.course.turns if training.course else ()
    asked = settings.fixed.iterations or QUALITIES[settings.quality].iterations
    worth = enough(asked)
    reason = f"at most {worth} of {asked} iterations, as scenes before gained less than {ENOUGH:g} dB by more"
    if cut:
        reason += (
            f"; the held-out quality hardly rose any more after {turns[-2][0]}, so the learning "
            f"rates came to their end in {turns[-1][0] - turns[-2][0]} more"
        )
    return (Rung(name="early stop", taken=cut or worth < asked, reason=reason),)
