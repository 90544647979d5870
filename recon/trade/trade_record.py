"""`trade.json`: what was trained for a trade-off, and what came of it."""

import hashlib
import json
import shlex
from datetime import datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from pydantic import Field

import imaging
import recon
from imaging.errors import InputError
from imaging.files import store
from imaging.record import Record, parse
from recon.decide import presets
from recon.decide.overrides import Overrides

FOLDER, TRADE = "trade", "trade.json"

Measure = Literal["raw_psnr", "ldr_psnr_oe", "hdr_psnr_mu"]
"""The method's own space: RAW mosaics, code values, or linear EXR in mu-law."""


class Choice(Record):
    """A training: a preset, and what of it is changed.

    axis: what it is there for.
    """

    axis: str
    quality: presets.QualityName = "standard"
    overrides: Overrides = Overrides()

    def command(self, session: str, method: str, seed: int) -> str:
        """Return what trains just this, to the byte."""
        sets = "".join(f" --set {word}" for word in self.overrides.words())
        return (
            f"rig reconstruct {shlex.quote(session)} --method {method} --quality {self.quality} "
            f"--seed {seed}{sets}"
        )


class Point(Record):
    """A finished training. db: mean over the held-out views of the trade's measure; views: of each."""

    key: str
    choice: Choice
    command: str
    iterations: int
    gaussians: int
    degree: int
    """Degree of the harmonics."""
    refine: str | None = None
    """Corrections of the calibration by training, joined by +, or None."""
    width: int
    """px of the training images."""
    device: str
    """Device of the training."""
    seconds: float
    """Seconds of training, wall clock."""
    processor_seconds: float
    """Processor seconds of all threads, reading and compiling included."""
    at_once: int
    """Trainings that may have shared the machine with it, itself included."""
    size_bytes: int
    splats_sha256: str
    db: float
    views: dict[str, float]
    truth_db: float | None = None
    """hdr_psnr_mu_aligned of a simulated session."""


class Trade(Record):
    """`trade.json`."""

    schema_version: Literal[1] = 1
    created: datetime
    versions: dict[str, str]
    code: str
    """Hash of the source that trains and measures."""
    calibration_sha256: str
    photographs_sha256: str
    """Hash of the shots of all views, with their masks."""
    depths_sha256: str
    """Hash of their depth maps; empty without any."""
    method: str
    seed: int
    measure: Measure
    width: int
    """px of the images that all points are measured on, as `load` takes it."""
    points: tuple[Point, ...] = ()
    failed: dict[str, str] = Field(default_factory=dict)
    """Trainings that failed, by their command, and why."""
    left_out: int = 0
    """Trainings that the budget had no time for."""


def read_trade(session: Path) -> Trade:
    """Read the trade-off of a session; InputError without one."""
    path = session / FOLDER / TRADE
    if not path.is_file():
        raise InputError(f"{session} has no trade-off yet: run `rig trade` first.")
    return parse(Trade, store.read_json(path), path)


@cache
def code_hash() -> str:
    """Hash of every module that can change a point: 16 hex digits. Presets are no code but settings."""
    digest = hashlib.sha256()
    for package in (imaging, recon):
        folder = Path(package.__path__[0])
        for path in sorted(set(folder.rglob("*.py")) - {Path(presets.__file__)}):
            digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def key_of(choice: Choice, trade: Trade) -> str:
    """Return what a point is known by: its settings, the photographs, the depth maps unless it leaves them
    out, the calibration and the code; 16 hex digits.
    """
    parts = [
        [choice.quality, vars(presets.QUALITIES[choice.quality]), presets.START_SHARE],
        choice.overrides.model_dump(mode="json"),
        [trade.method, trade.seed, trade.width, trade.code, version("torch")],
        [trade.calibration_sha256, trade.photographs_sha256],
        "" if choice.overrides.depth == 0 else trade.depths_sha256,
    ]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]
