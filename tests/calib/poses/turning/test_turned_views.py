"""Views from one place: their turns and their lens by matches alone, and what is no turn."""

import cv2
import numpy as np
import pytest

from calib.data.features import Features, MatchedPair
from calib.poses.sfm import fields_of
from calib.poses.turning.turned_views import TurnedViews, turned_views
from imaging.optics.lens import Lens, project
from imaging.session.view_id import ViewId

WIDTH, HEIGHT = 640, 480
NORMAL = Lens(model="OPENCV", width=WIDTH, height=HEIGHT, fx=600, fy=600, cx=322, cy=239, k1=-0.06, k2=0.01)
FISHEYE = Lens(
    model="OPENCV_FISHEYE", width=WIDTH, height=HEIGHT, fx=370, fy=370, cx=322, cy=239, k1=0.03, k2=-0.015
)
HEAD = [cv2.Rodrigues(np.array([0.3 * np.cos(step), 2 * np.pi * step / 12, 0.0]))[0] for step in range(12)]
"""Turns of a head that goes all the way round and nods a little."""


def looked(
    lens: Lens, turns: list[np.ndarray], moved: float = 0.0, noise: float = 0.3
) -> tuple[dict[ViewId, Features], dict[tuple[ViewId, ViewId], MatchedPair]]:
    """Features and matches of points 4 m away on all sides; moved: m between one view and the next."""
    rng = np.random.default_rng(4)
    points = rng.normal(size=(4000, 3))
    points *= rng.uniform(2, 6, (4000, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    features, shown = {}, {}
    for frame, turn in enumerate(turns):
        camera = (points - (moved * frame, 0, 0)) @ turn.T
        places = project(lens, np.where(camera[:, 2:] > 0.05, camera, (1, 1, 1e-3)))
        inside = (camera[:, 2] > 0.4 * np.linalg.norm(camera, axis=1)) & (places > 0).all(1)
        inside &= (places < (WIDTH, HEIGHT)).all(1)
        index = np.flatnonzero(inside)
        view = ViewId(frame, "cam")
        places = places[index] + rng.normal(0, noise, (len(index), 2))
        features[view] = Features(places, np.zeros((len(index), 128), np.uint8))
        shown[view] = index
    pairs = {}
    views = list(features)
    for number, one in enumerate(views):
        for other in views[number + 1 :]:
            _, here, there = np.intersect1d(shown[one], shown[other], return_indices=True)
            there = np.where(rng.random(len(there)) < 0.03, np.roll(there, 5), there)  # some are wrong
            if len(here) >= 30:
                index = np.stack([here, there], axis=1).astype(np.uint32)
                pairs[one, other] = MatchedPair(
                    features[one].points[here], features[other].points[there], index
                )
    return features, pairs


def placed(lens: Lens, guess: float, *, known: bool, turns: list[np.ndarray] = HEAD, moved: float = 0.0):
    features, pairs = looked(lens, turns, moved)
    start = Lens(model="OPENCV", width=WIDTH, height=HEIGHT, fx=guess, fy=guess, cx=WIDTH / 2, cy=HEIGHT / 2)
    return turned_views(features, pairs, {"cam": start}, (), {"cam"} if known else (), 3.0)


@pytest.mark.parametrize("lens", [NORMAL, FISHEYE], ids=["normal", "fisheye"])
@pytest.mark.parametrize("known", [True, False])
def test_turns_and_lens_are_those_of_the_head(lens: Lens, known: bool) -> None:
    views = placed(lens, 1.1 * lens.fx if known else 800, known=known)
    assert isinstance(views, TurnedViews)
    fields = fields_of(views.reconstruction)
    assert len(fields["poses"]) == len(HEAD)
    turns = [fields["poses"][ViewId(frame, "cam")].matrix() for frame in range(len(HEAD))]
    assert max(np.linalg.norm(pose[:3, 3]) for pose in turns) < 1e-12
    for frame, pose in enumerate(turns):
        relative = (pose[:3, :3] @ turns[0][:3, :3].T) @ (HEAD[frame] @ HEAD[0].T).T
        assert np.linalg.norm(cv2.Rodrigues(relative)[0]) < 0.5 / lens.fx  # half a pixel
    assert fields["lenses"]["cam"].fx == pytest.approx(lens.fx, rel=2e-3)
    assert fields["lenses"]["cam"].fisheye is lens.fisheye
    assert fields["reprojection_px"] < 0.6
    distances = [np.linalg.norm(point.xyz) for point in views.reconstruction.points3D.values()]
    assert len(distances) > 1000
    np.testing.assert_allclose(distances, 1.0, atol=1e-9)


def test_what_is_no_turn_is_left_to_structure_from_motion() -> None:
    assert placed(NORMAL, 600, known=True, moved=0.2) is None
    still = [cv2.Rodrigues(np.array([0.001 * step, 0.0, 0.0]))[0] for step in range(5)]
    assert placed(NORMAL, 600, known=True, turns=still) is None


def test_a_lens_of_a_board_stays() -> None:
    features, pairs = looked(NORMAL, HEAD)
    views = turned_views(features, pairs, {"cam": NORMAL}, {"cam"}, (), 3.0)
    assert isinstance(views, TurnedViews)
    lens = fields_of(views.reconstruction)["lenses"]["cam"]
    np.testing.assert_allclose(lens.terms, NORMAL.terms, rtol=1e-12)
