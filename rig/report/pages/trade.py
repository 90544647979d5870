"""SESSION/trade/report.html: quality against what it costs, what each setting buys, and every command."""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from os import PathLike
from pathlib import Path

import numpy as np

from imaging.and_list import and_list
from imaging.arguments import checked
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from recon.decide.presets import START_SHARE
from recon.observe.losses.photometric import Photometric
from recon.trade import Point, Trade, front, read_trade
from recon.trade.trade_record import FOLDER
from rig.report.charts.topic import Figure, Table, Tile, plus_minus
from rig.report.charts.trade_charts import PRESETS, comparable, costs, figures, is_preset
from rig.report.page import Page, now, write_page
from rig.report.sections.provenance import provenance
from rig.terminal.text import counted, duration, number, size

AXES = {
    "iterations": "iterations",
    "gaussians": "Gaussians",
    "width": "image width, px",
    "degree": "SH degree",
    "ssim": "weight of SSIM in the loss",
    "growth": "share of Gaussians that is grown",
    "views": "training views",
    "exposures": "exposures of a view",
    "refine": "corrections",
    "environment": "environment",
    "depth": "weight of measured depth",
}


@dataclass(frozen=True)
class TradeSection:
    """Everything the section shows."""

    lead: str
    caution: str
    figures: tuple[Figure, ...]
    tables: tuple[Table, ...]
    failed: tuple[tuple[str, str], ...]


@checked
def trade_report(session: str | PathLike[str]) -> Path:
    """Write the page of a session's trade-off.

    Args:
        session: Session, or its folder.

    Returns:
        The page.

    Raises:
        InputError: The session has no trade-off.
        StorageError: The disk refuses.
    """
    session = Path(session)
    opened, trade = Session.open(session), read_trade(session)
    page = Page(
        kind="Trade-off report",
        title=opened.record.name,
        lead=f"{counted(len(trade.points), 'training')} with method {trade.method}{_on(trade)}.",
        version=version("hdr-rig"),
        made=now(),
        tiles=tuple(_tiles(trade)),
        sections={
            "trade": trade_off(trade),
            "provenance": provenance(opened, read_calibration(session), None, version("hdr-rig")),
        },
    )
    path = session / FOLDER / "report.html"
    write_page(path, page)
    return path


def trade_off(trade: Trade) -> TradeSection:
    """A trade-off as the page shows it."""
    return TradeSection(
        lead="All scenes are measured on the same held-out views at the same size, whatever they were "
        "trained at. A dot is a training of its own: a moment of a longer one would look worse than it is, "
        "since its learning rates are still high.",
        caution=_caution(trade),
        figures=tuple(figures(trade)),
        tables=tuple(_tables(trade)),
        failed=tuple(trade.failed.items()),
    )


def _on(trade: Trade) -> str:
    """Return what its trainings ran on."""
    devices = sorted({point.device for point in trade.points})
    return f" on {and_list(devices)}" if devices else ""


def _caution(trade: Trade) -> str:
    """Return why the seconds of its trainings do not compare, if they do not."""
    several = max((point.at_once for point in trade.points), default=1)
    if several > 1:
        return (
            f"Up to {several} trainings shared a machine, so their seconds do not show how long one takes "
            "alone: processor time is drawn instead."
        )
    if comparable(trade):
        return ""
    return (
        "Not all trainings ran on machines of one kind, so the seconds of one say little of another: "
        "processor time is drawn instead, which depends on the kind less than seconds do."
    )


def _tiles(trade: Trade) -> Iterable[Tile]:
    for name in PRESETS:
        for point in trade.points:
            if is_preset(point, name):
                yield Tile(f"{point.db:.2f}", "dB", f"{name}, in {duration(point.seconds)}")


def _tables(trade: Trade) -> Iterable[Table]:
    standard = next((point for point in trade.points if is_preset(point, "standard")), None)
    if standard is not None:
        yield Table(
            "What each setting buys",
            "The preset standard with one thing changed; the error is that of the mean over held-out views, "
            "paired. A difference within twice its error may be chance. The time of standard includes its "
            "trials, whose results the others are given.",
            ("Changed", "#To", "#From", "#Gain, dB", "#Time", "#Size"),
            tuple(_changes(trade, standard)),
        )
    yield Table(
        "Every training",
        "Each command makes the same scene again, to the byte on the same machine.",
        (
            "#dB",
            "#dB to the truth",
            "#Time",
            "#Processor time",
            "#Gaussians",
            "#Size",
            "On the front of",
            "Command",
        ),
        tuple(_points(trade)),
    )


def settings(point: Point) -> dict[str, float | str | None]:
    """Return a training's settings, by hand or as its scene decided; None: the method's."""
    overrides = point.choice.overrides
    overridden = {key: getattr(overrides, key) for key in AXES}
    return overridden | {
        "iterations": point.iterations,
        "gaussians": overrides.gaussians or point.gaussians,
        "width": point.width,
        "degree": point.degree,
        "refine": point.refine or "none",
    }


def _changes(trade: Trade, standard: Point) -> Iterable[tuple[str, ...]]:
    """Rows of the trainings that differ from the standard one in a single setting."""
    usual = settings(standard)
    for axis, name in AXES.items():
        for point in trade.points:
            changed = settings(point)
            if [key for key in AXES if changed[key] != usual[key]] != [axis]:
                continue
            gains = np.array([point.views[view] - standard.views[view] for view in standard.views])
            error = float(gains.std(ddof=1) / np.sqrt(len(gains))) if len(gains) > 1 else None
            yield (
                name,
                _said(axis, changed[axis]),
                _said(axis, usual[axis]),
                f"{gains.mean():+.2f}" if error is None else plus_minus(float(gains.mean()), error),
                _times(point.seconds, standard.seconds),
                _times(point.size_bytes, standard.size_bytes),
            )


USUAL = {
    "ssim": f"{Photometric().ssim_weight:g}",
    "growth": f"{1 - START_SHARE:g}",
    "views": "all",
    "exposures": "all",
}
"""Default of a setting."""


def _said(axis: str, value: float | str | None) -> str:
    if value is None:
        return USUAL[axis]
    return value if isinstance(value, str) else f"{value:,.10g}"


def _times(value: float, usual: float) -> str:
    return f"× {number(value / usual, 2)}"


def _points(trade: Trade) -> Iterable[tuple[str, ...]]:
    fronts = {name: front(trade.points, cost, lambda p: p.db) for name, _, cost in costs(trade)}
    for point in sorted(trade.points, key=lambda point: point.seconds):
        yield (
            f"{point.db:.2f}",
            "n/a" if point.truth_db is None else f"{point.truth_db:.2f}",
            duration(point.seconds),
            duration(point.processor_seconds),
            f"{point.gaussians:,}",
            size(point.size_bytes),
            ", ".join(name for name, best in fronts.items() if point in best),
            point.command,
        )
