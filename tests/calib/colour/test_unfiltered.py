"""The row of W, measured in scenes whose sensor sees otherwise than its files say."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from calib.calibrate import calibrate
from calib.colour.unfiltered import NAME, mixture, smooth_cells
from capture.imports.photos import import_photos
from drivers.sim.camera.camera import Body, SimulatedCamera
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.files.raw import read_raw
from imaging.files.tiff.dng import write_dng
from imaging.merge.linear_frame import from_raw
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import raw_shot

SHARES = np.array((0.7, 1.1, 1.5))
"""Shares of R, G and B in W; files state the sum."""
TIMES = (1 / 500, 1 / 60, 1 / 15)


@pytest.fixture(scope="module")
def rig() -> SimulatedRig:
    return simulate("toy-rgbw", cameras=1, positions=2, width=480, height=360, samples=1)


def body(rig: SimulatedRig) -> Body:
    optics = rig.bodies[0].optics
    matrix = np.array(optics.camera_from_rec709, np.float64)
    matrix[3] = SHARES @ matrix[:3] / 1.5  # so that it saturates little before the others
    return replace(rig.bodies[0], optics=replace(optics, camera_from_rec709=matrix))


def shots(rig: SimulatedRig) -> list[RawMosaic]:
    taken = []
    camera = SimulatedCamera(body(rig), partial(rig.radiance, 0))
    for frame in range(rig.frames):
        camera.place(frame)
        for time in TIMES:
            taken.append(raw_shot(camera, Exposure(time=time, f_number=4.0, iso=100.0)))
    return taken


def test_the_mixture_is_that_of_the_sensor(rig: SimulatedRig) -> None:
    smooth = [smooth_cells(from_raw(shot, 1.0)) for shot in shots(rig)]
    cells, noise = (np.concatenate(parts) for parts in zip(*smooth, strict=True))
    shares = mixture(cells, noise, np.ones(3))
    np.testing.assert_allclose(shares, SHARES / 1.5, atol=0.02)


def test_what_the_colours_of_a_scene_do_not_tell_stays_as_files_say() -> None:
    rng = np.random.default_rng(0)
    grey = rng.uniform(0.1, 0.4, (500, 1)) * np.array([1.0, 1.0, 1.0, 2.7])
    shares = mixture(grey * rng.normal(1, 0.01, grey.shape), (0.01 * grey) ** 2, np.ones(3))
    assert shares.sum() == pytest.approx(2.7, rel=0.01)
    np.testing.assert_allclose(shares, 0.9, atol=0.1)


def test_a_calibration_has_the_row_that_was_measured(rig: SimulatedRig, tmp_path: Path) -> None:
    for number, shot in enumerate(shots(rig)):
        write_dng(tmp_path / "photos" / f"IMG_{number}.dng", shot)
    import_photos(tmp_path / "photos", tmp_path / "S", bracket=3)
    record = calibrate(tmp_path / "S", only="response")
    rows = np.array(record.cameras[0].camera_from_rec709)
    np.testing.assert_allclose(rows[3] @ np.linalg.inv(rows[:3]), SHARES / 1.5, atol=0.02)
    rung = next(rung for rung in record.rungs if rung.name == NAME)
    stated = read_raw(tmp_path / "photos" / "IMG_0.dng").camera_from_rec709
    assert stated is not None
    off = np.linalg.norm(rows[3] - stated[3]) / np.linalg.norm(stated[3])
    assert f"off by {100 * off:.1f} %" in rung.reason
