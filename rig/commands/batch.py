"""`rig batch`: many sessions with many settings."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.options.common import JsonOption
from rig.terminal.result import CommandResult, running
from rig.terminal.tables import table
from rig.terminal.text import counted

if TYPE_CHECKING:
    from rig.batch.run import BatchResult, BatchRow


def batch(
    plan: Annotated[
        Path, typer.Argument(metavar="PLAN.toml", help="Which sessions, and which scenes of each.")
    ],
    workers: Annotated[
        int,
        typer.Option(
            min=1, max=64, metavar="N", help="Commands at once; they share the cores and the memory evenly."
        ),
    ] = 1,
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            envvar="RAY_ADDRESS",
            help="Run on this Ray cluster instead, such as auto or ray://HOST:10001; its nodes see the "
            "sessions at the same paths.",
        ),
    ] = None,
    cores: Annotated[
        int, typer.Option(min=1, max=256, metavar="N", help="With --ray: cores that a command takes.")
    ] = 4,
    memory: Annotated[
        float,
        typer.Option(min=0.5, max=4096, metavar="GB", help="With --ray: memory that a command takes, in GB."),
    ] = 8.0,
    as_json: JsonOption = False,
) -> CommandResult:
    """Calibrate sessions and make scenes of them, as a plan says.

    PLAN.toml has `sessions = ["scans/*"]` and, for each scene that is to be made of each of them, a table
    [[scene]] with options of rig reconstruct (name, method, quality, budget, seed, set) and `export`, a list
    of files. What is calibrated or made already stays; what fails is listed, and the rest goes on. The same
    command goes on where it was stopped. Writes PLAN.batch.json and PLAN.batch.html beside the plan.

    Example: rig batch PLAN.toml --workers 2
    """
    with running("batch") as status:
        from rig.batch.plan import read_plan
        from rig.batch.processes import LocalWorkers, RayWorkers
        from rig.batch.run import carry_out
        from rig.report.pages.batch import batch_report

        read = read_plan(plan)
        pool = LocalWorkers(workers) if ray is None else RayWorkers(ray, cores, int(memory * 1e9))
        try:
            result = carry_out(read, pool.submit, on_progress=status, on_message=status.say)
        finally:
            pool.close()
        return _batch_result(result, batch_report(result))


def _batch_result(result: "BatchResult", report: Path) -> CommandResult:
    rows = [_cells(row) for row in result.rows]
    lines = table([("", rows)], ("Session", "Scene", "dB", "s", "Outcome"), {})
    lines.append(f"Report: {report}")
    failed = [row for row in result.rows if row.failed is not None]
    missing = None
    if failed:
        first = failed[0]
        missing = (
            f"{counted(len(failed), 'scene')} of {len(rows)} could not be made; {first.session}, "
            f"{first.failed}: {first.says}"
        )
    data = result.model_dump(mode="json") | {"report": str(report)}
    return CommandResult(data, lines, missing, usable=len(failed) < len(rows))


def _cells(row: "BatchRow") -> tuple[str, ...]:
    outcome = f"{row.failed} failed" if row.failed else "already there" if row.already_there else "made"
    return (
        str(row.session),
        row.scene,
        "" if row.db is None else f"{row.db:.1f}",
        f"{row.seconds:.0f}",
        outcome,
    )
