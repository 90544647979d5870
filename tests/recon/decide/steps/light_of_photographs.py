"""Photographs that state one exposure and one white balance, while the light before each was another."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.support import oracle
from capture.simulated import capture_simulated
from drivers.sim import rigs
from drivers.sim.rig_settings import RIGS
from imaging.arrays import Array, Array32
from imaging.files import store
from imaging.session.calibration import CalibrationRecord, read_calibration

CAMERAS, POSITIONS = 2, 8


def drawn(exposure: float, balance: float) -> Array:
    """Factors [positions, cameras, 3] of the light, of these standard deviations, natural log."""
    rng = np.random.default_rng(5)
    colours = balance * rng.standard_normal((POSITIONS, CAMERAS, 3))
    logs = exposure * rng.standard_normal((POSITIONS, CAMERAS, 1)) + colours
    return np.exp(logs - logs.mean(axis=(0, 1)))


@contextmanager
def lit_by(factors: Array) -> Iterator[None]:
    """Multiply the light before each simulated photograph."""
    render = rigs.SimulatedRig._render

    def lit(rig: rigs.SimulatedRig, camera: int, frame: int, subject: str) -> Array32:
        image = render(rig, camera, frame, subject)  # type: ignore[arg-type]
        return (image * factors[frame, camera]).astype(np.float32)

    toy = replace(RIGS["toy-ldr"], positions=POSITIONS, even=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rigs.SimulatedRig, "_render", lit)
        patch.setitem(RIGS, "toy-lit", toy)
        yield


def session_lit_by(folder: Path, factors: Array, asked: Array) -> Path:
    """A session of sixteen photographs, calibrated from the truth, in whose record points ask for `asked`."""
    with lit_by(factors):
        capture_simulated("toy-lit", folder, bracket=(0.0,))
        oracle.oracle_session(folder, "toy-lit", points=600)
    store.write_json(
        folder / "calibration" / "calibration.json",
        with_asked(read_calibration(folder), asked).model_dump(mode="json"),
    )
    return folder


def with_asked(record: CalibrationRecord, asked: Array) -> CalibrationRecord:
    """The record with factors [positions, cameras, 3] as calibration keeps them."""
    views = []
    for view in record.views:
        logs = np.log(asked[view.frame, int(view.camera.removeprefix("cam"))])
        asked_of_view = {
            "exposure_asked": float(np.exp(logs.mean())),
            "white_balance_asked": tuple(np.exp(logs - logs.mean()).tolist()),
        }
        views.append(view.model_copy(update=asked_of_view))
    return record.model_copy(update={"views": tuple(views)})
