"""`rig trade`: what settings cost and what they buy, on one's own session."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import JsonOption, SeedOption, SessionArgument
from rig.enter import entered
from rig.terminal.outcome import Outcome, running
from rig.terminal.progress import Meter
from rig.terminal.text import counted, size

if TYPE_CHECKING:
    from recon.trade import Point, Trade


PAGE_SHARE = 0.05
"""Of the time, kept for the page and for a training that is given up late."""


def trade(
    session: SessionArgument,
    budget: Annotated[
        str, typer.Option(metavar="TIME", help="Be done after this, as 90s or 10m, counted from Enter.")
    ] = "10m",
    workers: Annotated[
        int, typer.Option(min=1, max=64, help="Parallel trainings; timings become less reliable.")
    ] = 1,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> Outcome:
    """Measure what settings cost and what they buy.

    Trains the presets, then with one thing changed at a time (iterations, Gaussians, resolution, SH
    degree, loss, growth, views, exposures, corrections), then near the best; measures each on held-out
    views. Writes SESSION/trade/trade.json and report.html, with the command that makes each of the
    scenes. What is done is kept: the same command goes on where the budget or Ctrl-C ended.

    Example: rig trade S --budget 10m
    """
    with running("trade") as meter:
        from imaging.errors import InputError
        from recon.decide.budget import Budget

        limit = Budget.parse(budget)
        if limit.unit != "s":
            raise InputError(f"A trade-off is measured within a time, not {budget}: write it as 90s or 10m.")
        return run_trade(session, meter, limit.amount, workers, seed)


def run_trade(session: Path, meter: Meter, budget: float, workers: int, seed: int) -> Outcome:
    """Sweep, write the page and say what came of it; the page tells what there is after Ctrl-C too."""
    from recon.trade import sweep
    from rig.report.pages.trade import trade_report

    try:
        now = time.monotonic()
        left = (1 - PAGE_SHARE) * budget - (now - entered())
        found = sweep(
            session,
            budget=left,
            workers=workers,
            seed=seed,
            progress=meter,
            say=meter.say,
            until=now + left,
        )
    except KeyboardInterrupt:
        if (session / "trade" / "trade.json").is_file():
            trade_report(session)
        raise
    return told(session, found, trade_report(session))


def told(session: Path, found: "Trade", report: Path) -> Outcome:
    """A trade-off as an outcome: its front over time."""
    from recon.trade import front

    best = front(found.points, lambda point: point.seconds, lambda point: point.db)
    lines = [f"{session}: {counted(len(found.points), 'training')}, Pareto-optimal among them:"]
    lines += [f"  {_row(point)}" for point in best]
    if found.left:
        lines.append(f"{found.left} more did not fit the budget: run the same command to go on.")
    lines.append(f"Report: {report}")
    missing = None
    if not found.points:
        missing = f"No training of {session} was done in time: give a longer --budget."
    if found.failed:
        command, why = next(iter(found.failed.items()))
        missing = f"{counted(len(found.failed), 'training')} failed, the first is `{command}`: {why}"
    data = found.model_dump(mode="json") | {
        "session": str(session),
        "front": [point.key for point in best],
        "report": str(report),
    }
    return Outcome(data, lines, missing, usable=bool(found.points))


def _row(point: "Point") -> str:
    cost = f"{point.seconds:7.1f} s {point.gaussians:9,} Gaussians {size(point.size_bytes):>8}"
    return f"{point.db:6.2f} dB {cost}  {point.command}"
