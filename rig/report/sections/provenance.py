"""The section "Provenance": versions, seeds, hashes and the commands that reproduce it."""

import platform
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from imaging.files import store
from imaging.session.calibration import CalibrationRecord
from imaging.session.session import Session
from rig.report.charts.topic import plus_minus

if TYPE_CHECKING:
    from recon.result.model import ModelRecord


@dataclass(frozen=True)
class ProvenanceSection:
    """Everything the section shows."""

    rows: tuple[tuple[str, str], ...]
    commands: tuple[str, ...]


def provenance(
    session: Session,
    calibration: CalibrationRecord | None,
    model: "ModelRecord | None",
    version: str,
    name: str | None = None,
) -> ProvenanceSection:
    """Collect it from the records of the session; `name` is the reconstruction's folder."""
    return ProvenanceSection(
        rows=tuple(_rows(session, calibration, model, version)),
        commands=tuple(_commands(session, calibration is not None, model, name)),
    )


def _rows(
    session: Session,
    calibration: CalibrationRecord | None,
    model: "ModelRecord | None",
    version: str,
) -> Iterable[tuple[str, str]]:
    record = session.record
    yield "Session", record.name
    yield "Begun", record.created.isoformat(timespec="seconds")
    yield "Origin", record.origin
    if record.seed is not None:
        yield "Seed of the capture", str(record.seed)
    for plan in session.plans():
        yield f"Plan {plan.plan}", plan.reason
    shots = session.folder / "shots.jsonl"
    yield "shots.jsonl, SHA-256", store.sha256(shots)
    if calibration is not None:
        yield "Calibrated", calibration.created.isoformat(timespec="seconds")
        yield "Calibrated from shots", calibration.shots_sha256
        path = session.folder / "calibration" / "calibration.json"
        if path.is_file():
            yield "calibration.json, SHA-256", store.sha256(path)
        yield "Versions of the calibration", _versions(calibration.versions)
    if model is not None:
        yield "Trained", model.created.isoformat(timespec="seconds")
        chosen = model.settings
        yield "Training", f"{chosen.method}, quality {chosen.quality}, seed {chosen.seed}"
        yield "Iterations, as planned", f"{chosen.iterations:,}"
        yield "Most Gaussians", f"{chosen.max_gaussians:,}"
        yield "Widest image", f"{chosen.max_width:,} px"
        yield "Trained on calibration", model.calibration_sha256
        yield "Unit of light", model.radiance
        if model.luminance is not None:
            yield "Light of 1", plus_minus(*model.luminance, "cd/m²")
        yield "Versions of the training", _versions(model.versions)
    yield (
        "This page",
        f"rig {version}, Python {platform.python_version()}, {platform.system()} {platform.machine()}",
    )


def _versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in sorted(versions.items()))


def _commands(
    session: Session, calibrated: bool, model: "ModelRecord | None", reconstruction: str | None
) -> Iterable[str]:
    record = session.record
    name = shlex.quote(record.name)
    if record.origin.startswith("sim:"):
        yield f"rig capture --sim {shlex.quote(record.origin[4:])} --seed {record.seed or 0} {name}"
    elif record.origin == "import":
        yield f"rig import {_source(session)} {name}"
    else:
        yield f"rig capture {shlex.quote(record.origin)} {name}"
    if calibrated:
        yield f"rig calibrate {name}"
    if model is not None:
        from recon.decide.cost.budget import Budget
        from recon.result.training_folder import default_name

        chosen = model.settings
        options = f"--method {chosen.method} --quality {chosen.quality} --seed {chosen.seed}"
        asked = None if chosen.budget is None else Budget(chosen.budget, chosen.budget_unit)
        budget = "" if asked is None else f" --budget {asked}"
        usual = default_name(chosen.method, chosen.quality, asked)
        named = "" if reconstruction in (None, usual) else f" --name {shlex.quote(str(reconstruction))}"
        sets = "".join(f" --set {word}" for word in chosen.overrides.words())
        early = " --early-stop" if chosen.early_stop else ""
        yield f"rig reconstruct {name} {options}{budget}{early}{sets}{named}"


def _source(session: Session) -> str:
    """The folder that the first photograph was imported from, else a word for it."""
    for shot in session.shots():
        if shot.source:
            parent = Path(shot.source).parent
            if parent.name:
                return shlex.quote(str(parent))
    return "PHOTOS"
