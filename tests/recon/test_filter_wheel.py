"""`rig capture` of mono cameras behind filter wheels, from the cameras to a scene, against the truth."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from calib.calibrate import calibrate
from calib.exports.merge_session import merge
from capture.check.check import check
from capture.simulated import capture_simulated
from drivers.sim.rig_settings import RIGS
from imaging.files.exr.reading import read_exr
from imaging.files.raw import read_raw
from imaging.sensor.cfa import Cfa
from imaging.session.session import Session
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.measure.evaluation import Evaluation
from recon.measure.truth import calibration_errors
from recon.reconstruct import reconstruct

BANDS = ("450nm", "550nm", "650nm")


class Outcome(NamedTuple):
    session: Path
    errors: dict[str, float]
    metrics: Evaluation


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Six views, the wheels turned at every frame by the simulator."""
    session = tmp_path_factory.mktemp("wheel") / "S"
    with pytest.MonkeyPatch.context() as patch:
        larger = replace(RIGS["toy-wheel"], width=96, height=72, samples=2)
        patch.setitem(RIGS, "toy-wheel", larger)
        assert capture_simulated("toy-wheel", session, bracket=(-4.0, 0.0)).missing == ()
    calibration = calibrate(session)
    overrides = Overrides(iterations=100, gaussians=2000, degree=0, refine="none", environment=False)
    metrics = evaluate(reconstruct(session, TrainingRequest(quality="draft", overrides=overrides)))
    return Outcome(session, calibration_errors(session, calibration), metrics)


def test_every_band_is_shot_at_every_position(outcome: Outcome) -> None:
    session = Session.open(outcome.session)
    assert tuple(band.name for band in session.record.bands) == BANDS
    (plan,) = session.plans()
    assert plan.bands == tuple(band for band in BANDS for _ in range(2))
    shots = session.shots()
    assert len(shots) == 3 * 2 * 6
    assert all(shot.band == plan.bands[shot.step] for shot in shots)
    assert read_raw(session.file(shots[0])).cfa == Cfa.MONO


def test_check_compares_exposures_of_one_band_only(outcome: Outcome) -> None:
    """Light of different bands differs, and is neither motion nor a wrong label."""
    report = check(outcome.session)
    assert report.ok
    assert {problem.kind for problem in report.warnings} <= {"highlights"}


def test_brackets_are_merged_band_by_band(outcome: Outcome, tmp_path: Path) -> None:
    """Each file is the light of its band, up to one factor for all."""
    merge(outcome.session, tmp_path / "merged")
    files = sorted((tmp_path / "merged").rglob("*.exr"))
    assert [path.name for path in files] == [f"cam{n}.{band}.exr" for n in (0, 1) for band in BANDS] * 3
    ratios = []
    for path in files:
        camera, band, _ = path.name.split(".")
        truth = read_exr(outcome.session / "truth" / path.parent.name / f"{camera}.exr").channels
        channels = read_exr(path).channels
        known = channels["mask"] == 0
        true = truth[f"S0.{band.removesuffix('nm')},000000nm"]
        ratios.append(float(np.median(channels["G"][known] / true[known])))
    np.testing.assert_allclose(ratios / np.median(ratios), 1.0, atol=0.05)


def test_the_scene_has_the_light_of_every_band(outcome: Outcome) -> None:
    assert outcome.errors["pose_rotation_deg"] < 0.4
    rows = {row.band: row for row in outcome.metrics.bands}
    assert tuple(rows) == BANDS
    for name, row in rows.items():
        assert row.stops_median < 0.25, name
        assert row.hdr_psnr_mu_aligned > 30, name
