"""RealX3D's scenes (Liu et al., arXiv 2512.23437): photographs in bad conditions, clean ones to test on."""

import os
from pathlib import Path

from capture.imports.layouts.datasets import realx3d as layout
from imaging.progress import Progress
from recon.measure.protocols import realx3d
from rig.benchmarks.protocol import Choices, Column, Figures, Protocol, imported, trained


def _run(scene: Path, session: Path, choices: Choices, progress: Progress) -> Figures:
    imported(scene, session, "realx3d", progress)
    folder = trained(session, "auto", choices, progress)
    return realx3d.measure(folder, _laser(scene), progress)


def _laser(scene: Path) -> Path | None:
    """Folder of a scene's laser in its data set; None without one.

    The path as it is named goes first: a scene may be a link to another disk.
    """
    places = Path(os.path.abspath(scene)), scene.resolve()
    lasers = [place.parent.parent.parent / "pointclouds" / place.name for place in places]
    return next(filter(Path.is_dir, lasers), None)


REALX3D = Protocol(
    name="RealX3D",
    is_scene=layout.is_one,
    run=_run,
    columns={
        "psnr": Column("dB", 2),
        "ssim": Column("SSIM", 4),
        "psnr_exposed": Column("dB, one exposure", 2),
        "ssim_exposed": Column("SSIM, one exposure", 4),
        "depth_l1": Column("laser, m", 3),
    },
    published={
        "3DGS, low light, 7 scenes (github dfgcc534/3DGS4LL)": {"psnr": 6.61, "ssim": 0.058},
        "RetinexFormer, then 3DGS (the same)": {"psnr": 12.65},
        "3DGS4LL, NTIRE 2026 track 1, second (the same)": {"psnr": 22.76, "ssim": 0.777},
        "LITA-GS, low light, 9 scenes (arXiv 2606.11841)": {"psnr": 15.25, "ssim": 0.512},
        "LITA-GS with Adaptive Poly3 (the same)": {"psnr": 18.50, "ssim": 0.658},
        "SmokeGS-R, smoke, NTIRE 2026 track 2 (arXiv 2604.05301)": {"psnr": 15.217, "ssim": 0.666},
        "SmokeGS-R, the 7 released scenes (the same)": {"psnr": 15.209, "ssim": 0.644},
    },
    note="Clean photographs of the test poses at full size; one exposure: that of all test views together, "
    "which no published figure has. The published figures are of one condition each, so run a condition's "
    "folder; the laser's column is the mean absolute error of depth, and has no published counterpart.",
)
