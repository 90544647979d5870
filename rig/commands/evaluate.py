"""`rig evaluate`: how good a scene is."""

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from imaging.errors import RigError
from imaging.files import store
from imaging.session.paths import find_reconstruction, session_of
from recon.data import pixels
from recon.measure import evaluate as evaluating
from rig.options.common import JsonOption, ReconstructionsArgument
from rig.report.metric_words import METRICS, at_width, qualified
from rig.report.pages import reconstruction as reconstruction_page
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult, for_each_scene, running
from rig.terminal.text import number

MEASURING = 0.75
"""Share of the time until the report in which a scene is measured, before the page is drawn."""


def evaluate(reconstructions: ReconstructionsArgument, as_json: JsonOption = False) -> CommandResult:
    """Measure scenes on held-out views.

    Compares renders with the ground truth, if there is one, and with the photographs of the session, using
    the calibration that the scene was trained on. Scenes of one session are compared at the width of the
    widest. Writes metrics.json and report.html into the folder of each scene, and renders/ and references/
    with the same pictures as EXR and PNG, for comparison by other programs.

    Example: rig evaluate S/reconstructions/*
    """
    with running("evaluate") as status:
        widths = _widths(reconstructions)

        def measure(path: Path) -> CommandResult:
            folder = find_reconstruction(path)
            return run_evaluate(folder, status, widths.get(session_of(folder)))

        return for_each_scene(reconstructions, measure, "evaluated")


def _widths(paths: Sequence[Path]) -> dict[Path | None, int]:
    """Width, px, at which the scenes of each session are compared, where several are named."""
    scenes: dict[Path | None, list[Path]] = {}
    for path in paths:
        with suppress(RigError):  # its evaluation reports the fault
            folder = find_reconstruction(path)
            evaluating.common_width([folder])
            scenes.setdefault(session_of(folder), []).append(folder)
    return {
        session: evaluating.common_width(folders) for session, folders in scenes.items() if len(folders) > 1
    }


def run_evaluate(
    folder: Path, status: StatusLine, width: int | None = None, until: float = math.inf
) -> CommandResult:
    """Evaluate, write the report and return the result.

    width: px, at most; None: that of the training. until: reading of `time.monotonic` by which it should be
    done, as in `recon.measure.evaluate.evaluate` and `reconstruction_report`.
    """
    now = time.monotonic()
    with pixels.decoded_once():
        metrics = evaluating.evaluate(
            folder, width=width, until=now + MEASURING * (until - now), on_progress=status
        ).known()

        return _evaluation_result(
            folder,
            metrics,
            reconstruction_page.reconstruction_report(folder, until=until, on_progress=status),
        )


def evaluated_before(folder: Path) -> CommandResult | None:
    """The result of an evaluation that a scene has already, with its report; None if it has none."""
    report, metrics = folder / "report.html", folder / "metrics.json"
    if not (report.is_file() and metrics.is_file()):
        return None
    return _evaluation_result(folder, store.read_json(metrics), report)


def _evaluation_result(folder: Path, metrics: dict[str, Any], report: Path) -> CommandResult:
    """Result of an evaluation."""
    left_out = [metrics["left_out"]] if "left_out" in metrics else []
    lines = [f"{folder}: {headline(metrics)}", *left_out, f"Report: {report}"]
    return CommandResult({"reconstruction": str(folder), "metrics": metrics, "report": str(report)}, lines)


def headline(metrics: dict[str, Any]) -> str:
    """The numbers that say most, in one line."""
    words = [
        f"{metric.in_line}{qualified(metrics, metric.key)} "
        f"{number(metrics[metric.key])} {metric.unit}".strip()
        for metric in METRICS
        if metric.in_line and isinstance(metrics.get(metric.key), int | float)
    ]
    return (
        ", ".join(words) + at_width(metrics)
        if words
        else "no view was held out, so nothing could be measured"
    )
