"""`rig explain`: what was modelled of a scene, what not, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.options import JsonOption
from rig.running import Outcome, running
from rig.tables import table
from rig.words import counted, duration

if TYPE_CHECKING:
    from imaging.calibration import CalibrationRecord
    from imaging.records import PlanRecord, Rung
    from recon.model import ModelRecord
    from rig.report.calibrated import RungRow


def explain(
    place: Annotated[
        Path,
        typer.Argument(
            metavar="RECON",
            help="A reconstruction: SESSION/reconstructions/NAME; or a session that is calibrated.",
        ),
    ],
    as_json: JsonOption = False,
) -> Outcome:
    """Tell what was modelled, what not, and why.

    From the plan of the capture to the reconstruction: every part of a model that was considered, what
    it gained on data that was held out, what it costs, and whether it was taken.

    Example: rig explain S/reconstructions/nh-3dgs
    """
    with running("explain") as meter:
        from imaging.calibration import is_stale, read_calibration
        from imaging.session import Session

        folder, session = _found(place)
        meter("reading", 0, 0)
        plans = Session.open(session).plans()
        calibration = read_calibration(session)
        model = None
        if folder is not None:
            from recon.model import read_model

            model = read_model(folder)
        stale = is_stale(session, calibration)
    data: dict[str, Any] = {
        "session": str(session),
        "reconstruction": None if folder is None else str(folder),
        "capture": [_plan(plan) for plan in plans],
        "calibration": [rung.model_dump(mode="json") for rung in calibration.rungs],
        "calibration_is_stale": stale,
    }
    if model is not None:
        data["model"] = model.model_dump(
            mode="json", include={"settings", "gaussians", "train_seconds", "device"}
        )
        data["model_rungs"] = [rung.model_dump(mode="json") for rung in model.rungs]
        data["model_is_stale"] = model.created < calibration.created
    lines = list(_lines(session, folder, plans, calibration, model, stale))
    return Outcome(data, lines)


def _found(place: Path) -> tuple[Path | None, Path]:
    """The reconstruction, if there is one, and its session; InputError if there is neither."""
    from imaging.errors import InputError
    from rig.sessions import find_reconstruction, session_of

    if (place / "session.json").is_file():
        if not (place / "calibration" / "calibration.json").is_file():
            raise InputError(f"{place} has nothing to explain yet: run `rig calibrate` first.")
        models = any(place.glob("reconstructions/*/model.json"))
        return (find_reconstruction(place) if models else None), place
    folder = find_reconstruction(place)
    return folder, session_of(folder)


def _plan(plan: PlanRecord) -> dict[str, Any]:
    told = plan.model_dump(mode="json", include={"plan", "kind", "reason", "asked", "bracket"})
    exposures, frames, cameras = len(plan.bracket), len(plan.frames), len(plan.cameras)
    shots = exposures * frames * cameras
    return told | {"exposures": exposures, "frames": frames, "cameras": cameras, "shots": shots}


def _lines(
    session: Path,
    folder: Path | None,
    plans: Sequence[PlanRecord],
    calibration: CalibrationRecord,
    model: ModelRecord | None,
    stale: bool,
) -> Iterable[str]:
    from rig.report.calibrated import rung_groups, rung_rows

    yield f"{session}: capture, {counted(len(plans), 'plan')}"
    yield from table([("", [_plan_row(plan) for plan in plans])], ("Plan", "Exposures", "Why"), RATIOS)
    yield ""
    tally = _tally(calibration.rungs)
    yield f"{session}: calibration, {tally}{'; OUT OF DATE, shots were added since' if stale else ''}"
    groups = [(own.title, [_row(row) for row in own.rows]) for own in rung_groups(calibration.rungs)]
    yield from table(groups, COLUMNS, RATIOS)
    yield ""
    if model is None:
        yield f"{session}: no reconstruction yet, next: rig reconstruct {session}"
        return
    old = (
        "; OUT OF DATE, the session was calibrated again since" if model.created < calibration.created else ""
    )
    made = model.iterations or model.settings.iterations
    yield (
        f"{folder}: {model.settings.method}, {_tally(model.rungs)}; {duration(model.train_seconds)} on "
        f"{model.device}, {counted(model.gaussians, 'Gaussian')}, {made} iterations{old}"
    )
    yield from table([("", [_row(row) for row in rung_rows(model.rungs)])], COLUMNS, RATIOS)


COLUMNS = ("Part of the model", "Taken", "Evidence", "Cost", "Why")


def _tally(rungs: Sequence[Rung]) -> str:
    return f"{counted(len(rungs), 'part')} considered, {sum(rung.taken for rung in rungs)} taken"


def _plan_row(plan: PlanRecord) -> tuple[str, ...]:
    told = _plan(plan)
    steps = [str(exposure) if exposure is not None else "not stated" for exposure in plan.bracket]
    size = (
        f"{counted(told['exposures'], 'exposure')} x {counted(told['frames'], 'frame')} x "
        f"{counted(told['cameras'], 'camera')}"
    )
    between = steps[0] if len(set(steps)) == 1 else f"{steps[0]} to {steps[-1]}" if steps else ""
    name = plan.plan if plan.plan == plan.kind else f"{plan.plan} ({plan.kind})"
    return name, f"{size}{f': {between}' if between else ''}", plan.reason


def _row(row: RungRow) -> tuple[str, ...]:
    return row.name, "yes" if row.taken else "no", row.gain, row.cost, row.reason


RATIOS = {"Part of the model": 4, "Evidence": 5, "Why": 8, "Exposures": 5}
"""How columns share a line; the others are as wide as what they hold."""
