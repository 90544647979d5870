"""`rig evaluate`: how good a scene is."""

from pathlib import Path
from typing import Any

from rig.commands.options import JsonOption, ReconstructionArgument
from rig.progress import Meter
from rig.report.measures import validation
from rig.running import Outcome, running
from rig.sessions import find_reconstruction
from rig.words import number

HEADLINES = (
    ("hdr_psnr_mu_aligned", "HDR PSNR (mu-law, aligned)", "dB"),
    ("stops_median", "median error", "stops"),
    ("raw_psnr", "RAW PSNR", "dB"),
    ("ldr_psnr_oe", "PSNR", "dB"),
    ("ldr_psnr_ne", "PSNR at unseen exposures", "dB"),
    ("ssim", "SSIM", ""),
)


def evaluate(reconstruction: ReconstructionArgument, as_json: JsonOption = False) -> Outcome:
    """Measure a scene on held-out views.

    Against the truth where there is one. Writes metrics.json and report.html into its folder.

    Example: rig evaluate S/reconstructions/nh-3dgs
    """
    with running("evaluate") as meter:
        return run_evaluate(find_reconstruction(reconstruction), meter)


def run_evaluate(folder: Path, meter: Meter) -> Outcome:
    """Evaluate, write the report and say what came of it."""
    from recon.evaluate import evaluate as evaluate_scene

    metrics = evaluate_scene(folder, progress=meter)
    from rig.report.reconstruction_page import reconstruction_report

    report = reconstruction_report(folder, meter)
    lines = [f"{folder}: {headline(metrics)}", f"Report: {report}"]
    return Outcome({"reconstruction": str(folder), "metrics": metrics, "report": str(report)}, lines)


def headline(metrics: dict[str, Any]) -> str:
    """The numbers that say most, in one line."""
    words = [
        f"{name}{validation(metrics, key)} {number(metrics[key])} {unit}".strip()
        for key, name, unit in HEADLINES
        if isinstance(metrics.get(key), int | float)
    ]
    return ", ".join(words) or "no view was held out, so nothing could be measured"
