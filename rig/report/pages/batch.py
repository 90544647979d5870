"""PLAN.batch.html: what came of every scene of a plan, with links to their reports."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from urllib.parse import quote

from rig.batch.result import BatchResult, BatchRow
from rig.report.charts.topic import Tile
from rig.report.page import Page, now, write_page
from rig.terminal.text import counted, plain, size


@dataclass(frozen=True)
class SceneRow:
    """Scene in words. link: to its report, from the page; empty without a report."""

    session: str
    scene: str
    link: str
    db: str
    iterations: str
    seconds: str
    processor_seconds: str
    peak: str
    forecast: str
    outcome: str


@dataclass(frozen=True)
class BatchSection:
    """Everything the section shows."""

    rows: tuple[SceneRow, ...]


def batch_report(result: BatchResult) -> Path:
    """Write the page beside the plan; returns its path."""
    path = result.path(".html")
    failed = sum(row.failed is not None for row in result.rows)
    sessions = len({row.session for row in result.rows})
    tiles = [Tile(str(len(result.rows) - failed), "", "scenes"), Tile(str(failed), "", "failed")]
    if held_out := sorted(row.db for row in result.rows if row.db is not None):
        ends = dict.fromkeys(f"{db:.1f}" for db in (held_out[0], held_out[-1]))
        tiles.append(Tile(" – ".join(ends), "dB", f"held out{_at(result.rows)}"))
    page = Page(
        kind="Batch report",
        title=result.plan.stem,
        lead=f"{counted(len(result.rows), 'scene')} of {counted(sessions, 'session')}.",
        version=version("hdr-rig"),
        made=now(),
        tiles=tuple(tiles),
        sections={"batch": BatchSection(tuple(_in_words(row, path.parent) for row in result.rows))},
    )
    write_page(path, page)
    return path


def _at(rows: Sequence[BatchRow]) -> str:
    """`, at 640 px`: where the figures of scenes hold, which can be compared at one width only."""
    widths = sorted({row.width for row in rows if row.db is not None and row.width})
    if len(widths) < 2:
        return f", at {widths[0]} px" if widths else ""
    return f", at {widths[0]} to {widths[-1]} px: not to be compared"


def _link(report: Path, beside: Path) -> str:
    return quote(Path(os.path.relpath(report, beside)).as_posix())


def _in_words(row: BatchRow, beside: Path) -> SceneRow:
    outcome = "already there" if row.already_there else "made"
    if row.exports:
        outcome += f", exported {', '.join(path.name for path in row.exports)}"
    if row.says:
        outcome = f"{row.failed} failed: {row.says}" if row.failed else f"{outcome}; {row.says}"
    return SceneRow(
        session=plain(row.place),
        scene=row.scene,
        link="" if row.report is None or row.stored is not None else _link(row.report, beside),
        db=row.quality,
        iterations="" if row.iterations is None else f"{row.iterations:,}",
        seconds=f"{row.seconds:.0f}",
        processor_seconds="" if row.processor_seconds is None else f"{row.processor_seconds:.0f}",
        peak="" if row.peak is None else size(row.peak),
        forecast="" if row.forecast is None else size(row.forecast),
        outcome=plain(outcome),
    )
