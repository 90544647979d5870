"""Planes through points of known surfaces."""

import numpy as np

from recon.albedo.surface import planes_at


def test_normals_of_rough_planes_and_which_way_they_face() -> None:
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-1, 1, (2000, 2)), rng.normal(0, 0.01, 2000)])
    towards = np.tile([0.3, 0.0, -0.95], (2000, 1))
    planes = planes_at(points, np.ones(2000), towards)
    degrees = np.degrees(np.arccos(np.clip(-planes.normals[:, 2], -1, 1)))
    assert np.median(degrees) < 6
    assert np.median(np.abs(planes.points[:, 2])) < 0.005
    assert 0.003 < np.median(planes.thickness) < 0.02
    assert np.median(np.degrees(planes.tilt)) > np.median(degrees) / 3


def test_the_other_side_of_an_edge_counts_less() -> None:
    """A floor and a wall that meet at a right angle; beside the edge neighbours lie on both."""
    side = np.linspace(0.02, 1, 25)
    a, b = (part.ravel() for part in np.meshgrid(side, np.linspace(-1, 1, 50)))
    floor, wall = np.column_stack([a, b, 0 * a]), np.column_stack([0 * a, b, a])
    points = np.concatenate([floor, wall])
    planes = planes_at(points, np.ones(len(points)), np.tile([1.0, 0, 1.0], (len(points), 1)))
    true = np.repeat([[0, 0, 1.0], [1.0, 0, 0]], len(a), axis=0)
    degrees = np.degrees(np.arccos(np.clip((planes.normals * true).sum(1), -1, 1)))
    assert np.median(degrees) < 0.1
    assert np.quantile(degrees, 0.9) < 10


def test_what_does_not_count_is_not_looked_at() -> None:
    rng = np.random.default_rng(4)
    flat = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.zeros(500)])
    points = np.concatenate([flat, rng.normal(0, 0.3, (500, 3))])
    weights = np.repeat([1.0, 0.0], 500)
    planes = planes_at(points, weights, np.tile([0, 0, 1.0], (1000, 1)))
    np.testing.assert_allclose(planes.normals[:500], np.tile([0, 0, 1.0], (500, 1)), atol=1e-6)
