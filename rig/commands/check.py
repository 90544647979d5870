"""`rig check`: verify a session."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.check import check as checking
from capture.check import repair as repairing
from capture.record import capture_result
from imaging.errors import StorageError
from imaging.files import store
from rig.options.common import JsonOption, SessionArgument
from rig.report.pages import check as check_page
from rig.terminal.result import CommandResult, running
from rig.terminal.text import counted

if TYPE_CHECKING:
    from capture.check import findings

_SINGLE = frozenset(("index", "duplicate"))
"""Kinds of problems whose causes differ from shot to shot."""


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
        if repaired is not None:
            report = report.model_copy(update={"problems": tuple(map(_left_alone, report.problems))})
        data = report.model_dump(mode="json")
        page, refused = _written(session, report, data)
    lines = [f"{session}: {report.sound} of {counted(report.shots, 'shot')} sound, {report.planned} planned"]
    if repaired is not None:
        lines += [f"  dropped: {file}" for file in repaired.dropped]
        lines += [f"  added: {file}" for file in repaired.added]
        lines += [f"  renamed: {line}" for line in repaired.renamed]
        lines += [f"  left alone: {line}" for line in repaired.unrepaired]
        lines += [f"  the index as it was: {repaired.backup}"] if repaired.backup else []
    for step in report.exposures:
        clipped = "/".join(f"{100 * share:.2g}" for share in step.clipped)
        lines.append(
            f"  {step.camera}, {step.exposure or 'exposure not stated'}: {counted(step.shots, 'shot')}, "
            f"{clipped} % of R/G/B clipped, {100 * step.black:.2g} % black"
        )
    # Why a repair left a file alone is said above.
    said = [one for one in report.problems if repaired is None or one.kind != "stray"]
    lines += [f"  {message}" for message in _grouped(said)]
    lines += [f"  warning: {message}" for message in _grouped(report.warnings)]
    if report.untimed:
        bound = report.untimed_bound
        most = "" if bound is None else f", at most {capture_result.span(bound)}"
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


def _left_alone(problem: "findings.Problem") -> "findings.Problem":
    """The problem; of a file that a repair did not add without the advice to repair."""
    if problem.kind != "stray":
        return problem
    message = f"{problem.file} has no record: name it as a shot of a plan, or move it away."
    return problem.model_copy(update={"message": message})


def _grouped(problems: "Sequence[findings.Problem]") -> Iterator[str]:
    """The messages in their order; of several shots of a camera with the same problem only the first."""
    groups: dict[object, list[findings.Problem]] = {}
    for number, problem in enumerate(problems):
        single = problem.step is None or problem.kind in _SINGLE
        groups.setdefault(number if single else (problem.kind, problem.camera), []).append(problem)
    for first, *others in groups.values():
        if others:
            yield f"{first.camera}: {counted(1 + len(others), 'shot')}, such as: {first.message}"
        else:
            yield first.message


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
