"""HDR-Pretrain's scenes (Ye et al., InstantHDR, arXiv 2603.11298): brackets of rooms, and their light."""

from pathlib import Path

from capture.imports.layouts.datasets import hdr_pretrain as layout
from imaging.progress import Progress
from recon.measure.evaluate import evaluate
from recon.measure.protocols import hdr_pretrain
from rig.benchmarks.protocol import Choices, Column, Figures, Protocol, curved, imported, trained


def _run(scene: Path, session: Path, choices: Choices, progress: Progress) -> Figures:
    imported(scene, session, "hdr-pretrain", progress)
    curved(session, progress)
    folder = trained(session, "hdr-gs", choices, progress)
    figures = evaluate(folder, width=hdr_pretrain.SIDE, on_progress=progress).known()
    figures |= hdr_pretrain.measure(folder, progress)
    return {key: figures[key] for key in HDR_PRETRAIN.columns if key in figures}


HDR_PRETRAIN = Protocol(
    name="HDR-Pretrain",
    is_scene=layout.is_one,
    run=_run,
    columns={
        "ldr_psnr_oe": Column("LDR dB", 2),
        "ssim": Column("LDR SSIM", 4),
        "hdr_psnr_p99": Column("HDR dB", 2),
        "hdr_ssim_p99": Column("HDR SSIM", 4),
        "stops_median": Column("light, stops", 3),
    },
    published={},
    note="Trained on the five exposures of the views named train, tested on those named test at 448 px; HDR: "
    "mu-law over the 99th percentile of each picture, as InstantHDR evaluates; stops: median error after one "
    "scale. No figures stand beside: InstantHDR was trained on these scenes and is measured on others.",
)
