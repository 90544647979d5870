"""The section "Provenance": versions, seeds, hashes and the commands that reproduce it."""

import os
import platform
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from imaging.files import store
from imaging.session.calibration import COLOUR, CalibrationRecord
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
        commands=tuple(_commands(session, calibration, model, name)),
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
    session: Session,
    calibration: CalibrationRecord | None,
    model: "ModelRecord | None",
    reconstruction: str | None,
) -> Iterable[str]:
    record = session.record
    name = shlex.quote(record.name)
    given = None if calibration is None else _given_by(calibration)
    if record.origin.startswith("sim:"):
        options = f"--seed {record.seed or 0}{_planned(session)}"
        yield f"rig capture --sim {shlex.quote(record.origin[4:])} {options} {name}"
    elif record.origin == "import":
        yield f"rig import {_imported(session, given)} {name}"
    else:
        yield f"rig capture {shlex.quote(record.origin)} {name}"
    if calibration is not None and given is None:
        yield f"rig calibrate {name}"
    elif calibration is not None:
        yield from (f"rig calibrate {name} --only {part}" for part in _measured_parts(calibration))
    if model is not None:
        from recon.decide.cost.budget import Budget
        from recon.result.training_folder import default_name

        chosen = model.settings
        options = f"--method {chosen.method} --quality {chosen.quality} --seed {chosen.seed}"
        asked = None if chosen.budget is None else Budget(chosen.budget, chosen.budget_unit)
        budget = "" if asked is None else f" --budget {asked}"
        usual = default_name(chosen.method, chosen.quality, asked, all_views=chosen.all_views)
        named = "" if reconstruction in (None, usual) else f" --name {shlex.quote(str(reconstruction))}"
        sets = "".join(f" --set {word}" for word in chosen.overrides.words())
        early = " --early-stop" if chosen.early_stop else ""
        every = " --all-views" if chosen.all_views else ""
        yield f"rig reconstruct {name} {options}{budget}{early}{every}{sets}{named}"


def _planned(session: Session) -> str:
    """Options of a capture that its last plan of the scene records."""
    plan = next((plan for plan in reversed(session.plans()) if plan.kind == "scene"), None)
    if plan is None:
        return ""
    frames = f" --frames {len(plan.frames)}"
    if plan.asked is None:
        return frames
    if plan.asked.startswith("stops "):
        return f"{frames} --bracket {shlex.quote(plan.asked.removeprefix('stops ').replace(' ', ''))}"
    limits = [limit.rpartition(" ") for limit in plan.asked.split(", ")[1:]]
    words = [word for name, _, value in limits for word in (f"--{name.replace(' ', '-')}", value)]
    return f"{frames} --bracket auto {shlex.join(words)}".rstrip()


def _given_by(calibration: CalibrationRecord) -> str | None:
    """File or folder, relative to the imported one, that gave lenses and poses; None: they were measured."""
    for rung in calibration.rungs:
        if rung.name == "poses" and rung.reason.startswith("given by "):
            return rung.reason.removeprefix("given by ").removesuffix(", not measured")
    return None


def _measured_parts(calibration: CalibrationRecord) -> Iterable[str]:
    """Parts that were measured beside given poses: an import itself states noise and colour of RAW."""
    from calib.measures import MEASURES

    considered = {rung.name for rung in calibration.rungs} - {COLOUR, "sensor_noise"}
    for part, measures in MEASURES.items():
        if part is not None and measures.rungs & considered:
            yield part


def _imported(session: Session, given: str | None) -> str:
    """Path of the import, as a shell takes it: a video, else the folder of all photographs and of `given`."""
    from capture.imports.video.video import SUFFIXES

    sources = [shot.source for shot in session.shots("scene") if shot.source]
    if not sources:
        return "PHOTOS"
    video = sources[0].rpartition(": ")[0]
    if Path(video).suffix.lower() in SUFFIXES:
        return shlex.quote(video)
    folder = Path(os.path.commonpath([Path(source).parent for source in sources]))
    if given is not None:
        usual = folder.parent if folder.name.startswith(("images", "input")) else folder
        above = (place for place in (folder, *folder.parents) if _holds(place, given))
        folder = next(above, usual)
    return shlex.quote(str(folder))


def _holds(place: Path, given: str) -> bool:
    """Return whether a file or folder of poses is in a folder; the name of one may begin with its parent."""
    known, parts = place.resolve().parts, Path(given).parts
    return any(
        known[len(known) - count :] == parts[:count] and place.joinpath(*parts[count:]).exists()
        for count in range(len(parts) + 1)
    )
