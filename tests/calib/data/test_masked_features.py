"""Features behind a mask are no features."""

from types import SimpleNamespace

import cv2
import numpy as np

from calib.data.features import Features
from calib.view_images import _unmasked


def test_features_behind_the_mask_of_any_shot_are_dropped(tmp_path):
    """In a preview of half the size; of two shots one has a mask."""
    mask = np.full((20, 40), 255, np.uint8)
    mask[:, :10] = 0
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    shots = [SimpleNamespace(mask=name, width=40, height=20) for name in (None, "m.png")]
    points = np.array([[4.9, 3.0], [5.1, 3.0], [19.9, 9.9], [0.1, 0.1]])
    features = Features(points, np.eye(4, 128, dtype=np.float32))
    session = SimpleNamespace(mask=lambda shot: None if shot.mask is None else tmp_path / shot.mask)
    unmasked = _unmasked(session, SimpleNamespace(shots=shots), features, 20, 10)
    assert unmasked.points.tolist() == points[1:3].tolist()
    assert unmasked.descriptors.tolist() == features.descriptors[1:3].tolist()
    assert _unmasked(session, SimpleNamespace(shots=shots[:1]), features, 20, 10) is features
