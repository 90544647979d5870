"""HDR-Plenoxels' scenes (Jun-Seong et al., ECCV 2022): photographs of unknown exposure and white balance."""

from pathlib import Path

from capture.imports.layouts import llff
from imaging.files import store
from imaging.progress import Progress
from imaging.session.records import SplitRecord
from imaging.session.session import SPLIT, Session
from recon.measure.protocols import hdr_plenoxels
from rig.benchmarks.protocol import Choices, Column, Figures, Protocol, imported, trained

EVERY = 4
"""Stride of the test photographs, by name."""


def _run(scene: Path, session: Path, choices: Choices, progress: Progress) -> Figures:
    imported(scene, session, "llff", progress)
    _hold_out(session)
    folder = trained(session, "auto", choices, progress)
    return hdr_plenoxels.measure(folder, progress)


def _hold_out(session: Path) -> None:
    if (session / SPLIT).exists():
        return
    shots = Session.open(session).shots("scene")
    train, test = (
        tuple(shot.file for shot in shots if (shot.frame % EVERY == 0) == tested) for tested in (False, True)
    )
    record = SplitRecord(reason="HDR-Plenoxels", train=train, test=test)
    store.write_json(session / SPLIT, record.model_dump(mode="json"))


HDR_PLENOXELS = Protocol(
    name="HDR-Plenoxels",
    is_scene=llff.is_one,
    run=_run,
    columns={"psnr": Column("dB", 2), "ssim": Column("SSIM", 4)},
    published={
        "HDR-Plenoxels, 5 rendered scenes (its repository)": {"psnr": 26.86},
        "HDR-Plenoxels, 4 photographed scenes (its repository)": {"psnr": 28.32},
    },
    note="Right halves of every fourth photograph, each channel at the exposure that fits the left half, "
    "which training does not see (in the paper it does), at the width of the preset.",
)
