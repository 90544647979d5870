"""Processor seconds and bytes of each scene of a plan, estimated before anything is begun."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from imaging.compute.cores import available_cores
from imaging.errors import RigError
from imaging.record import Record
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from recon.data.holdout import EVERY, FEWEST_FOR_HOLDOUT
from recon.decide.cost.duration import BEGIN, Work
from recon.decide.presets import QUALITIES
from recon.result.model import MODEL
from recon.result.training_folder import names_of
from rig.batch.batch_plan import BatchPlan, PlannedScene

FEATURES = 1600
"""px of the longer side at which a calibration looks for features, and shows a view."""
VIEW, LOOK, FILE = 0.5, 1.2, 0.65
"""Processor seconds of a calibration: of a view; of its megapixels at `FEATURES`; of a megapixel of a file.
From eight views of 96x72 px, and the castle and the walk of README.md.
"""
BEGUN = 1.0
"""Processor seconds of a step of a batch before its work, in place of `duration.BEGIN`."""
PLACED, PREVIEW = 60_000, 1.8
"""Bytes of a calibration: of a view, and of its pixels at `FEATURES`."""
SPLAT, SHOWN, REPORT = 400, 29, 250_000
"""Bytes of a scene: of a Gaussian in model and checkpoint; of a pixel of a held-out view; of the report."""


class Estimate(Record):
    """Estimate of a scene of a session; its first scene has the calibration that is still to be made.

    processor_seconds: on processors, without GPUs. more: bytes that are added to the session. says: why there
    is no estimate.
    """

    session: Path
    scene: str
    processor_seconds: float = 0.0
    more: int = 0
    says: str = ""


def estimates(plan: BatchPlan) -> tuple[Estimate, ...]:
    """Estimate each scene of each session, in the order of the plan; no picture is read."""
    rows: list[Estimate] = []
    for session in plan.sessions:
        place = plan.place(session)
        if place is None:
            rows += [_estimate(session, session, number, scene) for number, scene in enumerate(plan.scenes)]
            continue
        with TemporaryDirectory() as folder:
            try:
                stored = place.manifest().rows
                place.fetch_records(Path(folder))
            except RigError as error:
                rows += [
                    Estimate(session=session, scene=scene.called, says=str(error)) for scene in plan.scenes
                ]
                continue
            rows += [
                Estimate(session=session, scene=scene.called)
                if scene.made_in(stored)
                else _estimate(session, Path(folder), number, scene)
                for number, scene in enumerate(plan.scenes)
            ]
    return tuple(rows)


def _estimate(session: Path, folder: Path, number: int, scene: PlannedScene) -> Estimate:
    """Return the estimate of a session's scene of that number. folder: with the session's records."""
    try:
        seconds, more = _scene(folder, scene)
        if number == 0 and not (folder / "calibration" / "calibration.json").is_file():
            calibration = _calibration(_shots(folder))
            seconds, more = seconds + calibration[0], more + calibration[1]
    except RigError as error:
        return Estimate(session=session, scene=scene.called, says=str(error))
    return Estimate(
        session=session, scene=scene.called, processor_seconds=round(seconds, 1), more=round(more)
    )


def _shots(session: Path) -> Sequence[ShotRecord]:
    return Session.open(session).shots("scene")


def _views(shots: Sequence[ShotRecord], width: int) -> list[float]:
    """Megapixels of each view, its longer side no longer than `width`."""
    first = {(shot.frame, shot.camera): shot for shot in shots}
    return [
        one.width * one.height * min(1.0, width / max(one.width, one.height, 1)) ** 2 / 1e6
        for one in first.values()
    ]


def _files(shots: Sequence[ShotRecord]) -> float:
    return sum(shot.width * shot.height for shot in shots) / 1e6


def _calibration(shots: Sequence[ShotRecord]) -> tuple[float, float]:
    """Processor seconds and bytes."""
    views = _views(shots, FEATURES)
    seconds = BEGUN + VIEW * len(views) + LOOK * sum(views) + FILE * _files(shots)
    return seconds, PLACED * len(views) + PREVIEW * 1e6 * sum(views)


def _scene(session: Path, scene: PlannedScene) -> tuple[float, float]:
    """Processor seconds and bytes; none of a scene that is there. InputError: no session."""
    request, shots = scene.request(), _shots(session)
    budget, preset, overrides = request.budget, QUALITIES[request.quality], request.overrides
    views = _views(shots, overrides.width or preset.width)
    if not views or any((session / "reconstructions" / name / MODEL).is_file() for name in names_of(request)):
        return 0.0, 0.0
    measured = len(views) >= FEWEST_FOR_HOLDOUT and not request.all_views
    held_out = -(-len(views) // EVERY) if measured else 0
    train = len(views) - held_out
    each = sum(views) / len(views)
    gaussians = request.most_gaussians(train, round(1e6 * each * train), overrides.degree or 0)
    raw = all(shot.file.lower().endswith(".dng") for shot in shots)
    work = Work(
        train=train,
        held_out=held_out,
        files=_files(shots),
        view=each,
        planes=len(shots) / len(views) * (1 if raw else 3),
        iterations=overrides.iterations or preset.iterations_of(train),
        gaussians=gaussians,
        trials=0,
        small_trials=0,
        small=each,
        width=overrides.width or preset.width,
    )
    seconds = work.processor_seconds()[0] - BEGIN + BEGUN
    if budget is not None and budget.unit == "s":
        seconds = budget.amount * available_cores()
    return seconds, SPLAT * gaussians + SHOWN * 1e6 * each * held_out + REPORT
