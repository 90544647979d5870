"""Pixel shift from a body's files to a scene, against the light that the simulator rendered."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from drivers.sim.rigs import simulate
from drivers.sim.truth import write_truth
from imaging.demosaicking.demosaic import demosaic
from imaging.files.raw import read_raw
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from imaging.session.session import Session
from recon.data.light import radiance_image
from recon.data.load import load
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.measure.evaluation import Evaluation
from recon.measure.truth import calibration_errors, true_radiance
from recon.reconstruct import reconstruct
from tests.drivers.pixel_shift import photograph

TIMES = 1 / 500, 1 / 30


class Outcome(NamedTuple):
    shifted: Path
    alone: Path
    errors: dict[str, float]
    metrics: Evaluation
    metrics_alone: Evaluation


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Six views as four files an exposure; and of the same session the first exposures, demosaicked."""
    home = tmp_path_factory.mktemp("shifted")
    rig = simulate("toy", cameras=2, positions=3, width=96, height=72, samples=2)
    photograph(rig, home / "photos", [Exposure(time=time, f_number=4.0, iso=100.0) for time in TIMES])
    import_photos(home / "photos", home / "shifted", pixel_shift=True, cameras="folder")
    write_truth(rig, home / "shifted")
    calibration = calibrate(home / "shifted")
    shutil.copytree(home / "shifted", home / "alone")
    session = Session.open(home / "alone")
    for shot in session.shots():
        first = read_raw(session.folder / shot.shifted[0])
        write_dng(session.file(shot), developed(first))
    metrics = []
    for folder in (home / "shifted", home / "alone"):
        overrides = Overrides(iterations=120, gaussians=2500, degree=0, refine="none", environment=False)
        metrics.append(evaluate(reconstruct(folder, TrainingRequest(quality="draft", overrides=overrides))))
    errors = calibration_errors(home / "shifted", calibration)
    return Outcome(home / "shifted", home / "alone", errors, *metrics)


def developed(first: RawMosaic) -> RawMosaic:
    """Estimate of three colours from one exposure alone, as a converter would store it."""
    assert first.cfa is not None
    black = float(np.mean(first.black))
    rgb = black + (first.white - black) * demosaic(first.signal(), first.cfa).rgb
    full = cv2.dilate(first.saturated().astype(np.uint8), np.ones((3, 3), np.uint8))[..., None] > 0
    pixels = np.where(full, first.white, np.rint(np.clip(rgb, 0, first.white - 1)))
    return replace(first, pixels=pixels.astype(np.uint16), cfa=None, black=((black,),), black_offset=None)


def off(session: Path) -> float:
    """RMS of light that shots tell over what is true, of all views, relative to its mean."""
    squares = []
    for view in load(session).train:
        light, trusted = radiance_image(view)
        truth = true_radiance(session, view)
        scale = np.median(truth[trusted] / light[trusted])
        squares.append(np.mean((scale * light - truth)[trusted] ** 2) / np.mean(truth[trusted]) ** 2)
    return float(np.sqrt(np.mean(squares)))


def test_views_are_placed_by_light_that_was_not_demosaicked(outcome: Outcome) -> None:
    assert outcome.errors["pose_rotation_deg"] < 0.2
    assert outcome.errors["exposure_ratio_error"] < 0.01


def test_shots_tell_more_than_the_first_exposure_of_each(outcome: Outcome) -> None:
    assert off(outcome.shifted) < 0.7 * off(outcome.alone)


def test_the_scene_is_nearer_to_the_light_than_that_of_first_exposures(outcome: Outcome) -> None:
    ours, alone = outcome.metrics, outcome.metrics_alone
    assert ours.hdr_psnr_mu_aligned > max(31.0, alone.hdr_psnr_mu_aligned + 3.0)
    assert ours.stops_median < min(0.2, 0.8 * alone.stops_median)
    assert ours.ciede2000_mean < 0.8 * alone.ciede2000_mean
