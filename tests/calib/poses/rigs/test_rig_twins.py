"""Views at a look-alike of their place, found by a rig whose frames are known."""

import cv2
import numpy as np
import pytest

from calib.data.features import MatchedPair
from calib.poses.rigs.rig_twins import twins
from imaging.session.view_id import ViewId

FRAMES = 8
RIG = [["left", "right"]]


def posed(turn, shift):
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.radians(np.asarray(turn, float)))[0]
    pose[:3, 3] = shift
    return pose


def rig(noise=0.0, frames=FRAMES):
    """cam_from_world of two cameras that go around a middle; noise: degrees by which the mounting gives."""
    rng = np.random.default_rng(0)
    poses = {}
    for frame in range(frames):
        first = posed((0, 0, 0), (0, 0, 5)) @ posed((0, 360 * frame / frames, 0), (0, 0, 0))
        poses[ViewId(frame, "left")] = first
        poses[ViewId(frame, "right")] = posed(noise * rng.normal(size=3), (-0.4, 0, 0)) @ first
    return poses


def matches(poses, weak=()):
    """Every two views share a hundred matches; weak ones share ten."""
    views = sorted(poses)
    return {
        (one, other): MatchedPair(
            *[np.zeros((10 if {one, other} & set(weak) else 100, 2))] * 2, np.zeros((1, 2), np.uint32)
        )
        for place, one in enumerate(views)
        for other in views[place + 1 :]
    }


@pytest.mark.parametrize("turned", [90.0, 180.0])
def test_a_camera_before_another_side_is_found(turned):
    poses = rig(noise=0.5)
    wrong = ViewId(3, "right")
    poses[wrong] = poses[wrong] @ posed((0, turned, 0), (0, 0, 0))
    assert twins(poses, matches(poses, [wrong]), RIG) == ({wrong}, FRAMES - 1)
    # What stands wrongly is the view that fewer matches hold, whichever camera it is of.
    other = ViewId(3, "left")
    assert twins(poses, matches(poses, [other]), RIG)[0] == {other}


def test_a_camera_before_the_next_of_equal_windows_is_found_by_its_shift():
    poses = rig()
    wrong = ViewId(5, "left")
    poses[wrong] = posed((0, 0, 0), (1.5, 0, 0)) @ poses[wrong]
    assert twins(poses, matches(poses, [wrong]), RIG)[0] == {wrong}


def test_a_rig_that_stays_as_it_is_loses_no_view():
    for noise in (0.0, 1.0):
        poses = rig(noise)
        assert twins(poses, matches(poses), RIG)[0] == frozenset()
    assert twins(poses, matches(poses), [["left"], ["right"]])[0] == frozenset()


def test_cameras_that_move_against_each_other_are_no_rig():
    poses = rig(noise=40.0)
    assert twins(poses, matches(poses), RIG)[0] == frozenset()
    few = rig(frames=3)
    few[ViewId(0, "left")] = few[ViewId(0, "left")] @ posed((0, 180, 0), (0, 0, 0))
    assert twins(few, matches(few), RIG)[0] == frozenset()
