"""HDR-NeRF's scenes (Huang et al., CVPR 2022): exposures that training saw, others, and the light."""

from pathlib import Path

from capture.imports.layouts.datasets import hdr_nerf
from imaging.progress import Progress
from recon.measure.evaluate import evaluate
from rig.benchmarks.protocol import Choices, Column, Figures, Protocol, curved, imported, trained


def _run(scene: Path, session: Path, choices: Choices, progress: Progress) -> Figures:
    imported(scene, session, "hdr-nerf", progress)
    curved(session, progress)
    folder = trained(session, "hdr-gs", choices, progress)
    figures = evaluate(folder, on_progress=progress).known()
    return {key: figures[key] for key in HDR_NERF.columns if key in figures}


HDR_NERF = Protocol(
    name="HDR-NeRF",
    is_scene=hdr_nerf.is_one,
    run=_run,
    columns={
        "ldr_psnr_oe": Column("OE dB", 2),
        "ssim": Column("OE SSIM", 4),
        "ldr_psnr_ne": Column("NE dB", 2),
        "ssim_ne": Column("NE SSIM", 4),
        "hdr_psnr_mu": Column("HDR dB", 2),
        "hdr_psnr_mu_aligned": Column("HDR dB, aligned", 2),
    },
    published={
        "HDRGS (Wu et al., arXiv 2408.06543), rendered": {"ldr_psnr_oe": 39.16},
        "HDRGS, photographed": {"ldr_psnr_oe": 33.34},
        "GaussHDR (CVPR 2025), rendered": {"ldr_psnr_oe": 42.29, "hdr_psnr_mu": 37.62},
        "GaussHDR, photographed": {"ldr_psnr_oe": 35.78, "ldr_psnr_ne": 33.33},
        "PhysHDR-GS (CVPR 2026), rendered": {
            "ldr_psnr_oe": 44.26,
            "ldr_psnr_ne": 43.19,
            "hdr_psnr_mu": 39.21,
        },
        "PhysHDR-GS, photographed": {"ldr_psnr_oe": 36.91, "ldr_psnr_ne": 34.15},
    },
    note="Trained on t1, t3 and t5 of every other view, tested on the others at those (OE) and at t2 and t4 "
    "(NE); HDR: mu-law, over the truth's maximum, and after one scale. The papers differ in their protocols.",
)
