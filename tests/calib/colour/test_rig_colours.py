"""White balance between the cameras of a simulated rig, against what the simulator gave them."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calib.colour.colour_record import balance, with_balance
from calib.data.views import read_view, scene_views
from calib.light.tracks import colour_at, light
from calib.sensor.metadata import CameraSensor
from imaging.files.colmap import pycolmap
from imaging.merge.bracket import merge_bracket
from imaging.sensor.mosaic import as_matrix
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.session import Session
from imaging.session.view_id import ViewId

WRONG = {
    "cam0": (1.06, 1.0, 0.95),
    "cam1": (0.96, 1.0, 1.04),
    "cam2": (1.0, 1.0, 1.0),
    "cam3": (0.97, 1.0, 0.98),
}
"""Errors of the matrices' white, by camera: as in files that a maker wrote for the model."""


@pytest.fixture(scope="module")
def tinted(arm: Path) -> CalibrationRecord:
    """The rig's calibration when its files name matrices that are off white, after its balance was found."""
    session, record = Session.open(arm), read_calibration(arm)
    model = pycolmap.Reconstruction(str(arm / "calibration" / "colmap"))
    places = {ViewId.of_image(image.name): image for image in model.images.values()}
    truth = json.loads((arm / "truth" / "truth.json").read_text())["cameras"]
    off = {}
    for camera in record.cameras:
        matrix = np.array(WRONG[camera.name])[:, None] * np.array(truth[camera.name]["camera_from_rec709"])
        off[camera.name] = as_matrix(matrix)
    colours = {}
    for view in scene_views(session):
        camera = record.camera(view.camera.name)
        merged_light = light(
            merge_bracket(read_view(session, view, record.exposure_scale, camera.response)),
            np.array(off[camera.name]),
        )
        points = np.array([point.xy for point in places[view.id].points2D])
        colours[view.id] = colour_at(merged_light, points, 320, 240)
    lenses = {camera.name: camera.lens for camera in record.cameras}
    sensors = {name: CameraSensor(None, matrix, lenses[name], True) for name, matrix in off.items()}
    falloff = SimpleNamespace(vignetting={camera.name: camera.vignetting for camera in record.cameras})
    equal = balance(SimpleNamespace(reconstruction=model, lenses=lenses), colours, sensors, falloff, [])
    cameras = tuple(
        camera.model_copy(update={"camera_from_rec709": off[camera.name]}) for camera in record.cameras
    )
    rungs = tuple(rung for rung in record.rungs if rung.name != "white_balance")
    return with_balance(record.model_copy(update={"cameras": cameras, "rungs": rungs}), equal)


def test_white_is_the_same_in_every_camera_again(arm: Path, tinted: CalibrationRecord) -> None:
    truth = json.loads((arm / "truth" / "truth.json").read_text())["cameras"]
    rung = next(rung for rung in tinted.rungs if rung.name == "white_balance")
    assert rung.taken
    assert rung.gain is not None
    assert rung.standard_error is not None
    assert rung.gain > 5 * rung.standard_error
    after, before = [], []
    for camera in tinted.cameras:
        true = np.array(truth[camera.name]["camera_from_rec709"])
        # What of each channel the record says, over what it is.
        after.append(np.log((np.array(camera.camera_from_rec709) / true).mean(axis=1)))
        before.append(np.log(WRONG[camera.name]))
        assert camera.white_balance_error is not None
    off, was = (np.array(table) - np.mean(table, axis=0) for table in (after, before))
    assert np.abs(was).max() > 0.05
    assert np.abs(off).max() < 0.005


def test_gains_are_those_of_the_simulator(arm: Path, tinted: CalibrationRecord) -> None:
    truth = json.loads((arm / "truth" / "truth.json").read_text())["cameras"]
    gains = np.log([[camera.gain, truth[camera.name]["gain"]] for camera in tinted.cameras])
    gains -= gains.mean(axis=0)
    np.testing.assert_allclose(gains[:, 0], gains[:, 1], atol=0.015)
