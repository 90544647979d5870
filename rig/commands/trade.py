"""`rig trade`: what settings cost and what they buy, measured on a session."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from imaging.compute import workers as pools
from imaging.errors import InputError
from recon.decide.cost import budget as budgets
from rig.batch import command_processes
from rig.options.common import CoresOption, JsonOption, RayOption, SeedOption, SessionArgument
from rig.report.pages import trade as trade_page
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult, running
from rig.terminal.start_time import started_at
from rig.terminal.text import counted, size

if TYPE_CHECKING:
    from recon.trade import Point, Trade

PAGE_SHARE = 0.05
"""Share of the time kept for the page and for a training that is given up late."""


def trade(
    session: SessionArgument,
    budget: Annotated[
        str,
        typer.Option(metavar="TIME", help="Finish within this time, such as 90s or 10m, counted from Enter."),
    ] = "10m",
    workers: Annotated[
        int,
        typer.Option(
            min=1,
            max=64,
            metavar="N",
            help="Trainings at once, each on its share of the cores: their seconds are then not those of one "
            "that has the machine to itself, and the page compares processor time.",
        ),
    ] = 1,
    ray: RayOption = None,
    cores: CoresOption = 4,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> CommandResult:
    """Measure the cost and the gain of settings.

    Trains the presets, then variations with one setting changed at a time (iterations, Gaussians, resolution,
    SH degree, loss, growth, views, exposures, corrections), then variations near the best; measures each on
    held-out views. Writes SESSION/trade/trade.json and report.html, with the command that makes each scene.
    Finished trainings are kept: the same command continues where the budget or Ctrl-C ended it. With --ray,
    seconds stay comparable if --cores is the number of cores of a node, and all nodes are identical.

    Example: rig trade S --budget 10m
    """
    with running("trade") as status:
        limit = budgets.Budget.parse(budget)
        if limit.unit != "s":
            raise InputError(f"A trade-off is measured within a time, not {budget}: write it as 90s or 10m.")
        if ray is None:
            return run_trade(session, status, limit.amount, workers, seed)

        with command_processes.begun(workers, ray, cores) as cluster:
            return run_trade(session, status, limit.amount, cluster, seed)


def run_trade(
    session: Path, status: StatusLine, budget: float, workers: "int | pools.Workers", seed: int
) -> CommandResult:
    """Sweep, write the page and return the result; after Ctrl-C too the page has all finished points."""
    from recon.trade import trade_sweep

    try:
        now = time.monotonic()
        seconds = (1 - PAGE_SHARE) * budget - (now - started_at())
        trade_off = trade_sweep(
            session,
            budget=seconds,
            workers=workers,
            seed=seed,
            on_progress=status,
            on_message=status.say,
            until=now + seconds,
        )
    except KeyboardInterrupt:
        if (session / "trade" / "trade.json").is_file():
            trade_page.trade_report(session)
        raise
    return _trade_result(session, trade_off, trade_page.trade_report(session))


def _trade_result(session: Path, trade_off: "Trade", report: Path) -> CommandResult:
    """Result of a trade-off: its front over time."""
    from recon.trade import front

    best = front(trade_off.points, lambda point: point.seconds, lambda point: point.db)
    lines = []
    if trade_off.points:
        trainings = counted(len(trade_off.points), "training")
        lines.append(
            f"{session}: {trainings}, all measured at {trade_off.width} px or less, "
            "Pareto-optimal among them:"
        )
        lines += [f"  {_row(point)}" for point in best]
        if trade_off.left_out:
            lines.append(f"{trade_off.left_out} more did not fit the budget: run the same command to go on.")
    if trade_off.points or trade_off.failed:
        lines.append(f"Report: {report}")
    missing = None
    if not trade_off.points:
        missing = f"No training of {session} was done in time: give a longer --budget."
    if trade_off.failed:
        command, why = next(iter(trade_off.failed.items()))
        missing = f"{counted(len(trade_off.failed), 'training')} failed, the first is `{command}`: {why}"
    data = trade_off.model_dump(mode="json") | {
        "session": str(session),
        "front": [point.key for point in best],
        "report": str(report),
    }
    return CommandResult(data, lines, missing, usable=bool(trade_off.points))


def _row(point: "Point") -> str:
    cost = f"{point.seconds:7.1f} s {point.gaussians:9,} Gaussians {size(point.size_bytes):>8}"
    return f"{point.db:6.2f} dB {cost}  {point.command}"
