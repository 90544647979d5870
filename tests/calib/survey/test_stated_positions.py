"""Places stated in photographs, against flights whose truth is known."""

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.calibration import tracks
from calib.adjustment.bundle_adjustment import Free, adjust, drop_outliers
from calib.adjustment.focal_priors import FocalPrior
from calib.adjustment.place_priors import StatedPlace
from calib.poses.places import align_to_places
from calib.sensor.focal_length import focal_length
from calib.survey.stated_positions import gimbal_turn, places_of
from imaging.files.colmap import pycolmap
from imaging.files.photo import read_metadata
from imaging.sensor.mosaic import FrameMetadata, GpsPosition
from imaging.session.view_id import ViewId

SCALE = 0.35


def test_a_gimbal_tells_where_the_camera_looks():
    level = gimbal_turn(0.0, 0.0, 0.0)
    np.testing.assert_allclose(level @ [0, 1, 0], [0, 0, 1], atol=1e-12)  # north is ahead
    np.testing.assert_allclose(level @ [0, 0, 1], [0, -1, 0], atol=1e-12)  # up is up
    east = gimbal_turn(90.0, 0.0, 0.0)
    np.testing.assert_allclose(east @ [1, 0, 0], [0, 0, 1], atol=1e-12)
    down = gimbal_turn(90.0, -90.0, 0.0)
    np.testing.assert_allclose(down @ [0, 0, -1], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(down @ [1, 0, 0], [0, -1, 0], atol=1e-12)  # east is the picture's upper edge
    # Past straight down, yaw and roll turn over together, and the camera hangs as before.
    np.testing.assert_allclose(gimbal_turn(-135.0, -90.0, 180.0), gimbal_turn(45.0, -90.0, 0.0), atol=1e-12)
    for turn in (level, east, down, gimbal_turn(10, -30, 5)):
        assert np.linalg.det(turn) == pytest.approx(1.0)


def photograph(altitude, height=None, error=None, orientation=1, altitude_error=None):
    position = GpsPosition(46.8, -92.0, altitude, error, altitude_error)
    return FrameMetadata(position=position, height=height, gimbal=(45.0, -89.9, 0.0), orientation=orientation)


def test_a_barometer_tells_heights_against_each_other_better_than_a_receiver():
    names = [ViewId(frame, "made") for frame in range(6)]
    pressed = places_of({view: photograph(200.0 + 5 * view.frame, 40.0) for view in names})
    heights = [place.centre[2] for place in pressed.values()]
    assert np.ptp(heights) < 1e-6
    assert pressed[names[0]].spread[2] < 1.0
    satellites = places_of({view: photograph(200.0 + 5 * view.frame, error=4.0) for view in names})
    assert np.ptp([place.centre[2] for place in satellites.values()]) == pytest.approx(25.0, rel=0.01)
    assert satellites[names[0]].spread.tolist() == [4.0, 4.0, 8.0]
    assert satellites[names[0]].turn is not None
    turned = places_of({names[0]: photograph(200.0, 40.0, orientation=6)})
    assert turned[names[0]].turn is None


def test_a_receiver_with_corrections_tells_heights_better_than_a_barometer():
    """The barometer drifts by 2.5 m; at the last photograph the corrections are lost, and 30 m with them."""
    photographs = {
        ViewId(frame, "made"): photograph(200.0, 40.0 + 0.5 * frame, 0.015, altitude_error=0.03)
        for frame in range(6)
    }
    places = places_of(photographs)
    assert np.ptp([place.centre[2] for place in places.values()]) < 1e-6
    assert {place.spread[2] for place in places.values()} == {0.03}
    lost = ViewId(6, "made")
    places = places_of({**photographs, lost: photograph(230.0, 41.25, 2.0, altitude_error=3.0)})
    assert np.ptp([place.centre[2] for place in places.values()]) < 1e-4
    assert places[lost].spread.tolist() == [2.0, 2.0, 0.4]


def flight(turned=True):
    """A flight over flat ground begun with at a focal length 3 % too long, and what its photographs state."""
    truth = tracks.truth("flat flight", 0, (-0.1,))
    model, rng, stated = tracks.noisy(truth, 0), np.random.default_rng(0), {}
    for index in sorted(truth.reg_image_ids()):
        image = truth.image(index)
        centre = np.ravel(image.projection_center()) + rng.normal(0, [1.0, 1.0, 0.3])
        turn = image.cam_from_world().rotation.matrix() if turned else None
        spread = np.array([2.5, 2.5, 0.4])
        stated[ViewId.of_image(image.name)] = StatedPlace(centre, spread, turn, np.radians(0.5), 0.26)
    other = pycolmap.Sim3d(
        0.1, pycolmap.Rotation3d(np.array([0.2, 0.0, 0.3, 0.93])), np.array([1.0, 2.0, 3.0])
    )
    model.transform(other)
    model.cameras[1].params = [824.0, 500.0, 375.0, -0.1]
    return truth, model, stated, Free(focal={1: FocalPrior(824.0, 25.0, held=True)})


def test_a_bowl_of_cameras_becomes_level_and_upright_by_what_photographs_state():
    truth, model, stated, free = flight()
    adjust(model, free, SCALE, 1)
    drop_outliers(model, 0.6)
    places, rung = align_to_places(model, stated)
    assert rung is not None
    assert rung.taken
    assert len(places) == 20
    adjust(model, replace(free, places=places), SCALE, 1)
    heights, tilts = [], []
    for index in sorted(truth.reg_image_ids()):
        image, true = model.image(index), truth.image(index)
        heights.append(float(image.projection_center()[2] - true.projection_center()[2]))
        apart = image.cam_from_world().rotation.matrix() @ true.cam_from_world().rotation.matrix().T
        tilts.append(np.degrees(np.linalg.norm(cv2.Rodrigues(apart)[0].ravel()[:2])))
    assert np.std(heights) < 0.1
    assert abs(np.mean(heights)) < 0.4
    assert np.median(tilts) < 0.3


def test_attitudes_of_another_convention_are_left_out_and_places_kept():
    _, model, stated, free = flight()
    upside = {
        view: replace(place, turn=np.diag([1.0, -1.0, -1.0]) @ place.turn) for view, place in stated.items()
    }
    adjust(model, free, SCALE, 1)
    places, rung = align_to_places(model, upside)
    assert rung is not None
    assert "attitudes do not" in rung.reason
    assert places
    assert all(place.turn is None for place in places.values())


@pytest.mark.parametrize("case", ["shuffled", "one spot", "few"])
def test_places_that_do_not_fit_change_nothing(case):
    _, model, stated, _ = flight(turned=False)
    views = list(stated)
    if case == "shuffled":
        order = np.random.default_rng(3).permutation(len(views))
        stated = {view: stated[views[row]] for view, row in zip(views, order, strict=True)}
    elif case == "one spot":
        stated = {view: replace(place, centre=0.05 * place.centre) for view, place in stated.items()}
    else:
        stated = {view: stated[view] for view in views[:4]}
    before = np.ravel(model.image(1).projection_center())
    places, rung = align_to_places(model, stated)
    assert places == {}
    assert rung is not None
    assert not rung.taken
    np.testing.assert_array_equal(np.ravel(model.image(1).projection_center()), before)
    assert align_to_places(model, {}) == ({}, None)


@pytest.mark.skipif("RIG_DATA" not in os.environ, reason="RIG_DATA is not set")
def test_a_real_flight_states_what_its_readme_says():
    """20 mm equivalent, 1,111 px of 2,000; altitudes within 0.4 m; the camera hangs straight down to 0.1."""
    files = sorted((Path(os.environ["RIG_DATA"]) / "brighton").glob("*.JPG"))
    metadata = {ViewId(frame, "drone"): read_metadata(file) for frame, file in enumerate(files)}
    focal = focal_length(metadata[ViewId(0, "drone")], 2000, 1125)
    assert focal is not None
    assert focal.px == pytest.approx(1111, rel=0.05)
    places = places_of(metadata)
    assert len(places) == 18
    assert np.ptp([place.centre[2] for place in places.values()]) <= 0.41
    for place in places.values():
        assert place.turn is not None
        assert place.turn[2] @ [0, 0, -1] > np.cos(np.radians(0.2))
