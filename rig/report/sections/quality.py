"""The section "Quality": metrics in plain words, views, errors by brightness, training, files."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from imaging.files import store
from imaging.session.view_id import ViewId
from recon.result.model import ModelRecord
from rig.report.charts.chart import AxisStyle, Series, chart
from rig.report.charts.topic import Tile
from rig.report.metric_words import BY_KEY, METRICS, at_width, qualified
from rig.report.sections.calibrated import RungRow, rung_rows
from rig.terminal.text import counted, duration, number, size

ENDINGS = {
    "early stop": "before its schedule did, since held-out views hardly got better",
    "goal": "when held-out views were as good as asked for",
    "interrupted": "by Ctrl-C; the same command continues from there",
}
_Chart = tuple[str, str, Markup]
"""A title, a sentence on what it shows, and the drawing."""


FILES = {
    "splats.ply": "The Gaussians as viewers of 3DGS show them: display values, exposed",
    "radiance.ply": "The same Gaussians with their linear light",
    "environment.exr": "Linear light from far away behind the Gaussians, by direction",
    "model.json": "What was trained, from what, with which choices; every view's lens and pose",
    "calibration.json": "The calibration that it was trained on",
    "refinement.json": "What training corrected in the calibration",
    "metrics.json": "The metrics of this page",
    "train.jsonl": "The training's log",
    "checkpoint.safetensors": "Every parameter, to render with and to continue from",
}


@dataclass(frozen=True)
class MetricRow:
    """One metric of the scene; `worst` is its value in the worst case, if that was measured."""

    name: str
    value: str
    unit: str
    worst: str
    meaning: str


@dataclass(frozen=True)
class FileRow:
    """A file beside the page; `link` is relative to it."""

    name: str
    link: str
    size: str
    meaning: str


@dataclass(frozen=True)
class QualitySection:
    """Everything the section shows."""

    lead: str
    note: str
    metrics: tuple[MetricRow, ...]
    columns: tuple[str, ...]
    views: tuple[tuple[str, ...], ...]
    charts: tuple[tuple[str, str, Markup], ...]
    cost: tuple[tuple[str, str], ...]
    rungs: tuple[RungRow, ...]
    files: tuple[FileRow, ...] = ()


def quality(
    folder: Path, model: ModelRecord, metrics: Mapping[str, Any], names: Mapping[ViewId, str]
) -> QualitySection:
    """Read a reconstruction's metrics and its training log for the page.

    names: of the photographs of an import (`Session.photograph_names`).
    """
    photographs = {str(view): f"{view} ({name})" for view, name in names.items()}
    rows = metrics.get("views", [])
    keys = [m.key for m in METRICS if any(m.key in row for row in rows)]
    return QualitySection(
        lead=f"Method {model.settings.method}, quality {model.settings.quality}: "
        f"{counted(len(model.training_views), 'view')} to train on, "
        f"{counted(len(model.held_out), 'view')} held out to measure with{at_width(metrics)}"
        f"{_ended_by(model)}",
        note=" ".join(str(metrics[key]) for key in ("held_out_note", "left_out") if key in metrics),
        metrics=tuple(_metric_rows(metrics)),
        columns=tuple(_column(key) for key in keys),
        views=tuple(
            (photographs.get(row["view"], row["view"]), *(BY_KEY[key].written(row.get(key)) for key in keys))
            for row in rows
        ),
        charts=tuple(_charts(folder, model, metrics)),
        cost=tuple(_cost(model, metrics)),
        rungs=rung_rows(model.rungs),
        files=tuple(_files(folder)),
    )


def _files(folder: Path) -> Iterable[FileRow]:
    """Every file of the scene but this page, hidden ones and those that are being written."""
    for path in sorted(folder.iterdir()):
        if path.is_file() and path.suffix not in (".html", ".part") and not path.name.startswith("."):
            link = quote(path.name)
            yield FileRow(path.name, link, size(path.stat().st_size), FILES.get(path.name, ""))


def _ended_by(model: ModelRecord) -> str:
    """Return how many of the held-out views influenced the training."""
    return f", {len(model.validation)} of them to end the training by" if model.validation else ""


def _metric_rows(metrics: Mapping[str, Any]) -> Iterable[MetricRow]:
    for metric in METRICS:
        value = metrics.get(metric.key)
        if value is not None:
            worst = metrics.get(f"{metric.key}_max")
            yield MetricRow(
                metric.name + qualified(metrics, metric.key),
                metric.written(value),
                metric.unit,
                "" if worst is None else metric.written(worst),
                metric.meaning,
            )


def _column(key: str) -> str:
    metric = BY_KEY[key]
    return f"{metric.name}, {metric.unit}" if metric.unit else metric.name


def _charts(folder: Path, model: ModelRecord, metrics: Mapping[str, Any]) -> Iterable[_Chart]:
    if decades := metrics.get("relative_error_by_decade"):
        yield _error_by_brightness(decades, model, metrics)
    lines = store.read_lines(folder / "train.jsonl")
    log = [row for row in lines if isinstance(row, dict) and "iteration" in row]
    if looked := [row for row in log if "held_out_db" in row]:
        yield _quality_over_time(looked, model)
    if log:
        yield from _training_over_time(log)


def _error_by_brightness(
    decades: Sequence[Mapping[str, float]], model: ModelRecord, metrics: Mapping[str, Any]
) -> _Chart:
    # The truth is in a unit of its own; what aligns the light with it leads to that of the calibration.
    absolute = None if model.luminance is None else model.luminance[0] / metrics["alignment_scale"]
    middle = [(absolute or 1.0) * math.sqrt(row["low"] * row["high"]) for row in decades]
    return (
        "Error by brightness",
        "How far the light of held-out views is from the truth, for each power of ten of the true light.",
        chart(
            "Relative error by decade of the true light",
            [
                Series(
                    "95 % of the pixels are better",
                    middle,
                    [100 * row["p95"] for row in decades],
                    colour=1,
                ),
                Series(
                    "half of the pixels are better",
                    middle,
                    [100 * row["median"] for row in decades],
                    colour=0,
                ),
            ],
            AxisStyle("true light, relative units" if absolute is None else "true light, cd/m²", "log"),
            AxisStyle("relative error, %", "log"),
        ),
    )


def _quality_over_time(looked: Sequence[Mapping[str, Any]], model: ModelRecord) -> _Chart:
    kind = "Validation" if model.validation else "Held-out"
    return (
        "Quality while it trained",
        f"{kind} views against their shots over training time.",
        chart(
            f"{kind} quality",
            [
                Series(
                    "",
                    [float(row["seconds"]) for row in looked],
                    [float(row["held_out_db"]) for row in looked],
                    colour=1,
                )
            ],
            AxisStyle("training time, s", zero=True),
            f"PSNR at {model.width} px, dB",
        ),
    )


def _training_over_time(log: Sequence[Mapping[str, Any]]) -> Iterable[_Chart]:
    seconds = [float(row["seconds"]) for row in log]
    yield (
        "Training",
        "Loss over training time; each point is a mean over the last iterations.",
        chart(
            "Training loss",
            [Series("", seconds, [float(row["loss"]) for row in log])],
            AxisStyle("training time, s", zero=True),
            AxisStyle("loss", "log" if min(float(row["loss"]) for row in log) > 0 else "linear"),
        ),
    )
    yield (
        "Size of the scene",
        "Gaussians over training time.",
        chart(
            "Number of Gaussians",
            [Series("", seconds, [float(row["gaussians"]) for row in log], colour=2)],
            AxisStyle("training time, s", zero=True),
            AxisStyle("Gaussians", zero=True),
        ),
    )


def _cost(model: ModelRecord, metrics: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    yield "Training time", f"{duration(model.train_seconds)} on {model.device}"
    yield "Iterations", f"{model.iterations or model.settings.iterations:,}"
    if model.ending != "schedule":
        yield "Ended", ENDINGS[model.ending]
    if model.predicted is not None and model.held_out_db is not None:
        guess = model.predicted
        yield (
            f"{'Validation' if model.validation else 'Held-out'} quality, predicted and reached",
            f"{guess.db:.1f} dB ({guess.low:.1f} to {guess.high:.1f}), {model.held_out_db:.1f} dB, "
            f"at {model.width} px",
        )
    yield "Gaussians", f"{model.gaussians:,}"
    if "size_bytes" in metrics:
        yield "Size of splats.ply", size(metrics["size_bytes"])
    if "render_fps" in metrics:
        yield "Renders per second", number(metrics["render_fps"], 2)


def tiles(model: ModelRecord, metrics: Mapping[str, Any]) -> tuple[Tile, ...]:
    """The headline numbers."""
    measured = (
        Tile(
            metric.written(metrics[metric.key]), metric.unit, metric.on_tile + qualified(metrics, metric.key)
        )
        for metric in METRICS
        if metric.on_tile and metrics.get(metric.key) is not None
    )
    return (
        *measured,
        Tile(f"{metrics.get('width', model.width)}", "px", "width that they are measured at"),
        Tile(duration(model.train_seconds), "", "training time"),
        Tile(f"{model.gaussians:,}", "", "Gaussians"),
    )
