"""RawNeRF's test scenes (Mildenhall et al., CVPR 2022): raw PSNR, and RGB after an affine fit."""

from pathlib import Path

from imaging.progress import Progress
from recon.measure.protocols import rawnerf
from rig.benchmarks.protocol import Choices, Column, Figures, Protocol, imported, trained

MERGED = "hdrplus_test/merged.dng"


def _is_scene(folder: Path) -> bool:
    return (folder / MERGED).is_file()


def _run(scene: Path, session: Path, choices: Choices, progress: Progress) -> Figures:
    imported(scene, session, "rawnerf", progress)
    folder = trained(session, "nh-3dgs", choices, progress)
    return rawnerf.measure(folder, scene / MERGED)


RAWNERF = Protocol(
    name="RawNeRF",
    is_scene=_is_scene,
    run=_run,
    columns={
        "raw_psnr": Column("RAW dB", 2),
        "rgb_psnr": Column("RGB dB", 2),
        "rgb_ssim": Column("RGB SSIM", 4),
    },
    published={
        "Raw3DGS (Li et al., arXiv 2406.08300)": {"raw_psnr": 59.49, "rgb_psnr": 23.53},
        "Scaffold-GS with the loss of RawNeRF (the same)": {"raw_psnr": 58.08, "rgb_psnr": 22.69},
    },
    note="Test views against the clean mosaic, at full resolution; RGB after an affine fit of each channel, "
    "as developed by multinerf. Published: 100 training views.",
)
