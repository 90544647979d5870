"""The photographs of `bench.support.walk` show their scene where its truth says."""

import json
from pathlib import Path

import cv2
import numpy as np

from bench.support.walk import House, lens_of, poses, take
from bench.support.walk_rays import LEVELS
from imaging.optics.lens import project

SIZE = 240, 180


def test_a_box_is_where_its_corners_are_projected(tmp_path: Path) -> None:
    boxes = np.array([[0.5, -0.3, 1.5, 1.5, 0.8, 1.0, 0.4, 1.0]])
    texels = np.full((1, 3), (20, 10, 5), np.uint8)
    at = np.tile(np.array([0, 1, 1], np.int64), (1, 6, LEVELS, 1))
    take(House(boxes, np.full((1, 6), 0.5, np.float32), texels, at), 3, tmp_path / "few", SIZE)
    truth = json.loads((tmp_path / "few.json").read_text())
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * boxes[0, 3:6]
    c, s = np.cos(0.4), np.sin(0.4)
    corners = signs @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + boxes[0, :3]
    for number, pose in enumerate(poses(3)):
        name = f"{number:04d}.jpg"
        assert np.array_equal(truth[name], pose)
        shown = cv2.imread(str(tmp_path / "few" / name))
        assert shown.shape == (SIZE[1], SIZE[0], 3)
        projected = project(lens_of(SIZE), corners @ pose[:3, :3].T + pose[:3, 3]) - 0.5
        expected = np.zeros(shown.shape[:2], np.uint8)
        cv2.fillConvexPoly(expected, cv2.convexHull(np.rint(projected).astype(np.int32)), 1)
        drawn = (shown.max(axis=2) < 100).astype(np.uint8)
        assert drawn.sum() > 1500
        # Edges are bent by the lens, and blurred by JPEG: they agree to two pixels.
        around = np.ones((5, 5), np.uint8)
        assert not (drawn & (1 - cv2.dilate(expected, around))).any()
        assert not (cv2.erode(expected, around) & (1 - drawn)).any()
