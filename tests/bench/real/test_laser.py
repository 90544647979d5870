"""Comparison with cameras that were measured by laser: published numbers are rounded."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.real.poses.laser import errors, truth


def test_turns_are_compared_below_the_rounding_of_published_ones(tmp_path: Path) -> None:
    """Camera files have six digits, and a turn of 0.01 degrees of one view has to show."""
    rng = np.random.default_rng(0)
    turns, centres = Rotation.random(12, random_state=1), rng.normal(0, 5, (12, 3))
    (tmp_path / "gt_dense_cameras").mkdir()
    ours = {}
    for number, (turn, centre) in enumerate(zip(turns.as_matrix(), centres, strict=True)):
        numbers = [*np.eye(3).ravel(), 0, 0, 0, *turn.T.ravel(), *centre, 3072, 2048]
        text = " ".join(f"{value:.6g}" for value in numbers)
        (tmp_path / "gt_dense_cameras" / f"{number:04}.jpg.camera").write_text(text)
        off = Rotation.from_rotvec([0, np.radians(0.01) if number == 3 else 0, 0]).as_matrix()
        pose = np.eye(4)
        pose[:3, :3] = off @ turn
        pose[:3, 3] = -off @ turn @ centre
        ours[f"{number:04}"] = pose
    published, _ = truth(tmp_path)
    angles = errors(ours, published)["turns"]
    assert abs(angles[3] - 0.01) < 0.002
    assert max(angles[:3] + angles[4:]) < 0.002
