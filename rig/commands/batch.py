"""`rig batch`: many sessions with many settings."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from rig.batch import batch_plan as plans
from rig.batch import command_processes, run, shards
from rig.batch import estimates as estimating
from rig.batch import result as results
from rig.options.common import CoresOption, JsonOption, RayOption
from rig.report.pages import batch as batch_page
from rig.terminal.result import CommandResult, running
from rig.terminal.tables import table
from rig.terminal.text import counted, duration, size


def batch(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN.toml", help="Which sessions, and which scenes of each.")
    ],
    workers: Annotated[
        int,
        typer.Option(
            min=1,
            max=64,
            metavar="N",
            help="Number of commands at once: each has its share of the cores, and begins when its predicted "
            "memory is free.",
        ),
    ] = 1,
    ray: RayOption = None,
    cores: CoresOption = 4,
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="i/N",
            help="Only the i-th of N parts of the sessions, as a task of a job array.",
        ),
    ] = None,
    merge: Annotated[
        bool,
        typer.Option("--merge", help="Only join the results of all shards in one table and page."),
    ] = False,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Only estimate the processor seconds and bytes of each scene; begin nothing."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> CommandResult:
    """Calibrate sessions and reconstruct scenes by a plan.

    PLAN.toml has `sessions = ["scans/*"]` and, for each scene to make from every session, a table [[scene]]
    with options of rig reconstruct (name, method, quality, budget, seed, set) and `export`, a list of files.
    Existing calibrations and scenes are kept; failed steps are listed, and the others continue. The same
    command resumes where it was stopped. The memory of each step is predicted, and a step begins when that
    much is free. Sessions and scenes can be in object storage: `sessions = ["s3://bucket/scans/*"]` and
    `output = "s3://bucket/scenes"`. Writes PLAN.batch.json and PLAN.batch.html beside the plan.

    Example: rig batch PLAN.toml --workers 2
    """
    read = plans.read_plan(plan)
    if merge:
        result, unmade = shards.merged(read)
        result.write()
        return _batch_result(result, batch_page.batch_report(result), unmade)
    if shard is not None:
        read = shards.shard_of(read, shard)
    if dry_run:
        return _estimated(estimating.estimates(read))
    if ray is not None:
        read = shards.absolute(read)  # its workers have other working folders
    with running("batch") as status:
        with command_processes.begun(workers, ray, cores) as several:
            result = run.carry_out(read, several, on_progress=status, on_message=status.say)
        return _batch_result(result, batch_page.batch_report(result), None)


def _estimated(rows: "Sequence[estimating.Estimate]") -> CommandResult:
    seconds, more = sum(row.processor_seconds for row in rows), sum(row.more for row in rows)
    cells = [
        (str(row.session), row.scene, f"{row.processor_seconds:.0f}", size(row.more), row.says)
        for row in rows
    ]
    lines = table([("", cells)], ("Session", "Scene", "CPU s", "Adds", "No estimate"), {})
    lines.append(f"About {duration(seconds)} of processor time and {size(more)} in all.")
    refused = [row for row in rows if row.says]
    missing = f"{counted(len(refused), 'scene')} cannot be estimated: {refused[0].says}" if refused else None
    data = {
        "estimates": [row.model_dump(mode="json") for row in rows],
        "processor_seconds": seconds,
        "bytes": more,
    }
    return CommandResult(data, lines, missing, usable=len(refused) < len(rows))


def _batch_result(result: "results.BatchResult", report: Path, unmade: str | None) -> CommandResult:
    rows = [_cells(row) for row in result.rows]
    lines = table(
        [("", rows)], ("Session", "Scene", "Held-out", "s", "CPU s", "Memory", "Forecast", "Outcome"), {}
    )
    lines.append(f"Report: {report}")
    failed = [row for row in result.rows if row.failed is not None]
    partial = [row for row in result.rows if row.says]
    sentences = [unmade] if unmade else []
    if failed:
        first = failed[0]
        sentences[:0] = [
            f"{counted(len(failed), 'scene')} of {len(rows)} could not be made; {first.place}, "
            f"{first.failed}: {first.says}"
        ]
    elif partial:
        first = partial[0]
        sentences[:0] = [
            f"{counted(len(partial), 'scene')} of {len(rows)} could only be made in part; {first.place}: "
            f"{first.says}"
        ]
    missing = " ".join(sentences) or None
    data = result.model_dump(mode="json") | {"report": str(report)}
    return CommandResult(
        data, lines, missing, usable=len(failed) < len(rows) or (not rows and unmade is None)
    )


def _cells(row: "results.BatchRow") -> tuple[str, ...]:
    outcome = "made in part" if row.says else "made"
    if row.failed or row.already_there:
        outcome = f"{row.failed} failed" if row.failed else "already there"
    return (
        row.place,
        row.scene,
        row.quality,
        f"{row.seconds:.0f}",
        "" if row.processor_seconds is None else f"{row.processor_seconds:.0f}",
        "" if row.peak is None else size(row.peak),
        "" if row.forecast is None else size(row.forecast),
        outcome,
    )
