"""`rig check`: prove what a session holds."""

from typing import Annotated

import typer

from rig.commands.options import JsonOption, SessionArgument
from rig.running import Outcome, running
from rig.words import counted


def check(
    session: SessionArgument,
    repair: Annotated[
        bool, typer.Option("--repair", help="Bring the index back in line with the files first.")
    ] = False,
    as_json: JsonOption = False,
) -> Outcome:
    """Prove what a session holds.

    Reads every file and holds it against its record: hashes, exposures, clipping, skew.

    Example: rig check S
    """
    repaired = None
    with running("check") as meter:
        from capture.check import check as check_session
        from capture.repair import repair as repair_session

        if repair:
            repaired = repair_session(session, progress=meter)
        report = check_session(session, progress=meter)
    lines = [f"{session}: {report.sound} of {counted(report.shots, 'shot')} sound, {report.planned} planned"]
    if repaired is not None:
        lines += [f"  dropped: {file}" for file in repaired.dropped]
        lines += [f"  added: {file}" for file in repaired.added]
        lines += [f"  left alone: {line}" for line in repaired.left]
        lines += [f"  the index as it was: {repaired.backup}"] if repaired.backup else []
    for one in report.exposures:
        clipped = "/".join(f"{100 * share:.2g}" for share in one.clipped)
        lines.append(
            f"  {one.camera}, {one.exposure or 'exposure not stated'}: {counted(one.shots, 'shot')}, "
            f"{clipped} % of R/G/B clipped, {100 * one.black:.2g} % black"
        )
    lines += [f"  {problem.message}" for problem in report.problems]
    missing = None
    if report.problems:
        missing = f"{session} has {counted(len(report.problems), 'problem')}: {report.problems[0].message}"
    elif not report.sound:
        missing = f"{session} holds no shots: capture or import some first."
    data = report.model_dump(mode="json")
    if repaired is not None:
        data["repaired"] = repaired.model_dump(mode="json")
    return Outcome(data, lines, missing, usable=report.sound > 0)
