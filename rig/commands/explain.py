"""`rig explain`: what was modelled of a scene, what not, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from imaging.errors import InputError
from imaging.session import calibration as calibrations
from imaging.session import records
from imaging.session import session as sessions
from imaging.session.paths import find_reconstruction, session_of
from recon.data import load
from recon.result import model as trained
from rig.options.common import JsonOption
from rig.report.sections import calibrated
from rig.terminal.result import CommandResult, running
from rig.terminal.tables import table
from rig.terminal.text import command_line, counted, duration


def explain(
    place: Annotated[
        Path,
        typer.Argument(
            metavar="RECON",
            help="A reconstruction: SESSION/reconstructions/NAME; or a session that is calibrated.",
        ),
    ],
    as_json: JsonOption = False,
) -> CommandResult:
    """Explain modelling decisions.

    Lists every part of a model that was considered, from the capture plan to the reconstruction: its gain on
    held-out data, its cost, and whether it was applied.

    Example: rig explain S/reconstructions/nh-3dgs-standard
    """
    with running("explain") as status:
        folder, session = _folders(place)
        status("reading", 0, 0)
        decisions = _read(folder, session, of_session=place == session)
    data: dict[str, Any] = {
        "session": None if session is None else str(session),
        "reconstruction": None if folder is None else str(folder),
        "capture": [_plan(plan) for plan in decisions.plans],
        "calibration": [rung.model_dump(mode="json") for rung in decisions.calibration.rungs],
        "calibration_is_stale": decisions.shots_added,
    }
    if decisions.model is not None:
        data["model"] = decisions.model.model_dump(
            mode="json", include={"settings", "gaussians", "train_seconds", "device"}
        )
        data["model_rungs"] = [rung.model_dump(mode="json") for rung in decisions.model.rungs]
        data["model_is_stale"] = decisions.calibrated_again
    return CommandResult(data, list(_lines(decisions)))


@dataclass(frozen=True)
class _Decisions:
    """Subject to explain: a session, a scene in it, or a scene alone.

    calibration: the session's, or where a scene was named the one that it was trained on.
    """

    folder: Path | None
    session: Path | None
    plans: Sequence[records.PlanRecord]
    calibration: calibrations.CalibrationRecord
    model: trained.ModelRecord | None
    shots_added: bool
    """True if shots were added since the calibration."""
    calibrated_again: bool
    """True if the session was calibrated again since the training."""


def _read(folder: Path | None, session: Path | None, *, of_session: bool) -> _Decisions:

    plans = [] if session is None else sessions.Session.open(session).plans()
    model = None
    if folder is not None:
        model = trained.read_model(folder)
    if folder is not None and not of_session:
        calibration = trained.read_own_calibration(folder)
    else:
        assert session is not None
        calibration = calibrations.read_calibration(session)
    added = session is not None and calibrations.is_stale(session, calibration)
    again = False
    if session is not None and model is not None and (session / "calibration" / "calibration.json").is_file():
        again = load.calibration_sha256(session) != model.calibration_sha256
    return _Decisions(folder, session, plans, calibration, model, added, again)


def _folders(place: Path) -> tuple[Path | None, Path | None]:
    """The reconstruction and its session, as far as they are there; InputError if neither is."""
    if (place / "session.json").is_file():
        if not (place / "calibration" / "calibration.json").is_file():
            raise InputError(f"{place} has nothing to explain yet: run `rig calibrate` first.")
        models = any(place.glob("reconstructions/*/model.json"))
        return (find_reconstruction(place) if models else None), place
    folder = find_reconstruction(place)
    return folder, session_of(folder)


def _plan(plan: records.PlanRecord) -> dict[str, Any]:
    data = plan.model_dump(mode="json", include={"plan", "kind", "reason", "asked", "bracket"})
    exposures, frames, cameras = len(plan.bracket), len(plan.frames), len(plan.cameras)
    shots = exposures * frames * cameras
    return data | {"exposures": exposures, "frames": frames, "cameras": cameras, "shots": shots}


def _lines(decisions: _Decisions) -> Iterable[str]:

    if decisions.session is not None:
        yield f"{decisions.session}: capture, {counted(len(decisions.plans), 'plan')}"
        rows = [_plan_row(plan) for plan in decisions.plans]
        yield from table([("", rows)], ("Plan", "Exposures", "Why"), PLANS)
        yield ""
    rungs = decisions.calibration.rungs
    old = "; OUT OF DATE, shots were added since" if decisions.shots_added else ""
    yield f"{decisions.session or decisions.folder}: calibration, {_tally(rungs)}{old}"
    groups = [(group.title, [_row(row) for row in group.rows]) for group in calibrated.rung_groups(rungs)]
    yield from table(groups, COLUMNS, PARTS)
    yield ""
    model = decisions.model
    if model is None:
        yield f"{decisions.session}: no reconstruction yet"
        yield f"Next: {command_line('rig', 'reconstruct', decisions.session)}"
        return
    old = "; the session was calibrated again since" if decisions.calibrated_again else ""
    made = model.iterations or model.settings.iterations
    yield (
        f"{decisions.folder}: {model.settings.method}, {_tally(model.rungs)}; "
        f"{duration(model.train_seconds)} on {model.device}, "
        f"{counted(model.gaussians, 'Gaussian')}, {made} iterations{old}"
    )
    yield from table([("", [_row(row) for row in calibrated.rung_rows(model.rungs)])], COLUMNS, PARTS)


COLUMNS = ("Part of the model", "Taken", "Why")


def _tally(rungs: Sequence[records.Rung]) -> str:
    return f"{counted(len(rungs), 'part')} considered, {sum(rung.taken for rung in rungs)} taken"


def _plan_row(plan: records.PlanRecord) -> tuple[str, ...]:
    counts = _plan(plan)
    steps = [str(exposure) if exposure is not None else "not stated" for exposure in plan.bracket]
    size = (
        f"{counted(counts['exposures'], 'exposure')} x {counted(counts['frames'], 'frame')} x "
        f"{counted(counts['cameras'], 'camera')}"
    )
    between = steps[0] if len(set(steps)) == 1 else f"{steps[0]} to {steps[-1]}" if steps else ""
    name = plan.plan if plan.plan == plan.kind else f"{plan.plan} ({plan.kind})"
    return name, f"{size}{f': {between}' if between else ''}", plan.reason


def _row(row: calibrated.RungRow) -> tuple[str, ...]:
    """The part, whether it was taken, and why: in brackets what a trial gained, and what it costs."""
    measured = ", ".join(words for words in (row.gain if row.tried else "", row.cost) if words)
    why = f"{row.reason} ({measured})" if measured else row.reason
    return row.name, "yes" if row.taken else "no", why


PLANS, PARTS = {"Plan": 4, "Exposures": 5, "Why": 8}, {"Part of the model": 2, "Why": 7}
"""Layout of columns that share a line; the others are as wide as their contents."""
