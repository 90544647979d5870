"""Learned features and matches against a motion of the picture that is known."""

import cv2
import numpy as np
import pytest

from calib.data import learned
from calib.data.features import Features, _matched, find

SIZE = 320, 240


class Camera:
    """Fields of a pycolmap camera that matching reads."""

    width, height = SIZE


def picture(seed: int = 0) -> np.ndarray:
    """Spots of many sizes, grey, in 0..1."""
    rng = np.random.default_rng(seed)
    layers = [
        cv2.resize(rng.random((SIZE[1] // step, SIZE[0] // step), np.float32), SIZE) for step in (4, 10, 40)
    ]
    return np.asarray(np.clip(sum(layers) / 3, 0, 1), np.float32)


@pytest.mark.skipif(not learned.available(), reason=f"learned features: {learned.INSTALL}")
def test_matches_follow_a_known_motion_of_the_picture():
    motion = np.array([[0.85, -0.2, 60.0], [0.15, 0.9, 5.0], [1e-4, 2e-4, 1.0]])
    one = picture()
    # warpPerspective counts pixel centres from 0, features from 0.5.
    other = np.clip(0.6 * cv2.warpPerspective(one, motion, SIZE, borderMode=cv2.BORDER_REFLECT) + 0.1, 0, 1)
    here, there = find(one, "learned"), find(other.astype(np.float32), "learned")
    assert here.kind == "learned"
    pairs = _matched(here, there, (Camera, Camera))
    assert len(pairs) > 100
    moved = cv2.perspectiveTransform((here.points[pairs[:, 0]] - 0.5)[None], motion)[0] + 0.5
    away = np.linalg.norm(moved - there.points[pairs[:, 1]], axis=1)
    assert np.mean(away < 2.0) > 0.9
    assert abs(np.median(moved - there.points[pairs[:, 1]], axis=0)).max() < 0.3
    nothing = Features(np.empty((0, 2)), np.empty((0, 128), np.float32), "learned")
    assert _matched(here, nothing, (Camera, Camera)).shape == (0, 2)


@pytest.mark.skipif(not learned.available(), reason=f"learned features: {learned.INSTALL}")
@pytest.mark.parametrize("shape", [(1, 1), (16, 16), (2, 900), (17, 17), (17, 640), (40, 1300)])
def test_small_and_narrow_pictures_have_few_features_or_none(shape):
    places, descriptors = learned.extract(np.random.default_rng(0).random(shape, np.float32))
    assert len(places) == len(descriptors)
    assert descriptors.shape[1] == 128
    assert (places >= 0).all()
    assert (places <= shape[::-1]).all()
