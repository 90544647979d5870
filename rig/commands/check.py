"""`rig check`: verify a session."""

from pathlib import Path
from typing import Annotated, Any

import typer

from capture.check import check as checking
from capture.check import repair as repairing
from imaging.errors import StorageError
from imaging.files import store
from rig.options.common import JsonOption, SessionArgument
from rig.report.pages import check as check_page
from rig.terminal.result import CommandResult, running
from rig.terminal.text import counted


def check(
    session: SessionArgument,
    repair: Annotated[bool, typer.Option("--repair", help="Rebuild the index from the files first.")] = False,
    as_json: JsonOption = False,
) -> CommandResult:
    """Verify a session.

    Reads every file and compares it with its record and the rest of its bracket: hashes, exposures
    against labels, clipping, focus, motion, skew; what masks hide is not compared. Writes
    S/check/report.html, a contact sheet of every shot, and S/check/check.json, unless S is read-only.

    Example: rig check S
    """
    repaired = None
    with running("check") as status:
        if repair:
            repaired = repairing.repair(session, on_progress=status)
        report = checking.check(session, on_progress=status)
        data = report.model_dump(mode="json")
        page, refused = _written(session, report, data)
    lines = [f"{session}: {report.sound} of {counted(report.shots, 'shot')} sound, {report.planned} planned"]
    if repaired is not None:
        lines += [f"  dropped: {file}" for file in repaired.dropped]
        lines += [f"  added: {file}" for file in repaired.added]
        lines += [f"  left alone: {line}" for line in repaired.unrepaired]
        lines += [f"  the index as it was: {repaired.backup}"] if repaired.backup else []
    for step in report.exposures:
        clipped = "/".join(f"{100 * share:.2g}" for share in step.clipped)
        lines.append(
            f"  {step.camera}, {step.exposure or 'exposure not stated'}: {counted(step.shots, 'shot')}, "
            f"{clipped} % of R/G/B clipped, {100 * step.black:.2g} % black"
        )
    lines += [f"  {problem.message}" for problem in report.problems]
    lines += [f"  warning: {warning.message}" for warning in report.warnings]
    if report.untimed:
        bound = report.untimed_bound
        most = "" if bound is None else f", at most {1000 * bound:.3g} ms"
        lines.append(f"  skew unknown{most}: {', '.join(report.untimed)} do not say when their shutters open")
    lines += [f"Contact sheet: {page}"] if page else []
    lines += [f"  no contact sheet: {refused}"] if refused else []
    missing = None
    if report.problems:
        missing = f"{session} has {counted(len(report.problems), 'problem')}: {report.problems[0].message}"
    elif not report.sound:
        missing = f"{session} holds no shots: capture or import some first."
    data["report"] = None if page is None else str(page)
    if repaired is not None:
        data["repaired"] = repaired.model_dump(mode="json")
    return CommandResult(data, lines, missing, usable=report.sound > 0)


def _written(
    session: Path, report: "checking.CheckReport", data: dict[str, Any]
) -> tuple[Path | None, str | None]:
    """Write the page of a session that has shots, or return the reason why not: a session may be
    read-only.
    """
    if not report.looks:
        return None, None

    try:
        page = check_page.check_report(session, report)
        store.write_json(session / "check" / "check.json", data)
    except StorageError as error:
        return None, str(error)
    return page, None
