"""`rig evaluate`: how good a scene is."""

from pathlib import Path
from typing import Any

from imaging.files import store
from imaging.session.paths import find_reconstruction
from rig.options.common import JsonOption, ReconstructionsArgument
from rig.report.metrics import METRICS, validation
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult, for_each_scene, running
from rig.terminal.text import number


def evaluate(reconstructions: ReconstructionsArgument, as_json: JsonOption = False) -> CommandResult:
    """Measure scenes on held-out views.

    Against the truth where there is one, and against the photographs of their session, as the scene was
    calibrated when it was trained. Writes metrics.json and report.html into the folder of each scene, and
    renders/ and references/ with the same pictures as EXR and PNG, for any other program to compare.

    Example: rig evaluate S/reconstructions/*
    """
    with running("evaluate") as status:
        return for_each_scene(
            reconstructions, lambda path: run_evaluate(find_reconstruction(path), status), "evaluated"
        )


def run_evaluate(folder: Path, status: StatusLine) -> CommandResult:
    """Evaluate, write the report and say what came of it."""
    from recon.data.pixels import decoded_once
    from recon.evaluate import evaluate as evaluate_scene

    with decoded_once():
        metrics = evaluate_scene(folder, on_progress=status).known()
        from rig.report.pages.reconstruction import reconstruction_report

        return _evaluation_result(folder, metrics, reconstruction_report(folder, on_progress=status))


def evaluated_before(folder: Path) -> CommandResult | None:
    """The result of an evaluation that a scene has already, with its report; None if it has none."""
    report, metrics = folder / "report.html", folder / "metrics.json"
    if not (report.is_file() and metrics.is_file()):
        return None
    return _evaluation_result(folder, store.read_json(metrics), report)


def _evaluation_result(folder: Path, metrics: dict[str, Any], report: Path) -> CommandResult:
    """What came of an evaluation."""
    lines = [f"{folder}: {headline(metrics)}", f"Report: {report}"]
    return CommandResult({"reconstruction": str(folder), "metrics": metrics, "report": str(report)}, lines)


def headline(metrics: dict[str, Any]) -> str:
    """The numbers that say most, in one line."""
    words = [
        f"{metric.in_line}{validation(metrics, metric.key)} "
        f"{number(metrics[metric.key])} {metric.unit}".strip()
        for metric in METRICS
        if metric.in_line and isinstance(metrics.get(metric.key), int | float)
    ]
    return ", ".join(words) or "no view was held out, so nothing could be measured"
