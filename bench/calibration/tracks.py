"""Made tracks: points as a camera sees them on flights, walks and rings, without any pictures."""

from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import lens_of
from imaging.arrays import Array, Integers
from imaging.files.colmap import pycolmap
from imaging.optics.lens import project
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL = 1000, 750, 800.0
NOISE, WRONG, FARTHEST = 0.3, 0.03, 20.0
"""px: standard deviation of a place; share of places that are wrong; by how much at most."""
KINDS = ("flat flight", "flight over houses", "walk ahead", "walk aside", "ring")
LENSES = {"straight": (0.0,), "bent": (-0.12,)}


def truth(kind: str, seed: int, radial: tuple[float, ...] = (0.0,), points: int = 500) -> Any:
    """A scene without noise as a pycolmap model, whose world is x east, y north, z up, in metres."""
    rng = np.random.default_rng((3, seed, KINDS.index(kind)))
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_RADIAL", FOCAL, WIDTH, HEIGHT)
    camera.params = [FOCAL, WIDTH / 2, HEIGHT / 2, radial[0]]
    model.add_camera_with_trivial_rig(camera)
    world, poses = _scene(kind, rng, points)
    numbers = [model.add_point3D(point, pycolmap.Track(), np.zeros(3, np.uint8)) for point in world]
    for place, pose in enumerate(poses):
        places, which = _projected(model, pose, world)
        image = pycolmap.Image()
        image.name, image.camera_id, image.image_id = ViewId(place, "made").image_name, 1, place + 1
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(xy) for xy in places])
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
        for row, point in enumerate(which.tolist()):
            model.add_observation(numbers[point], pycolmap.TrackElement(place + 1, row))
    for number in numbers:
        if model.exists_point3D(number) and model.points3D[number].track.length() < 2:
            model.delete_point3D(number)
    return model


def noisy(model: Any, seed: int, noise: float = NOISE) -> Any:
    """A copy whose places are off by noise, and a few of them by much."""
    rng = np.random.default_rng((4, seed))
    copy = pycolmap.Reconstruction(model)
    for index in sorted(copy.reg_image_ids()):
        for point in copy.image(index).points2D:
            miss = rng.normal(0, noise, 2)
            if rng.random() < WRONG:
                miss = rng.uniform(-FARTHEST, FARTHEST, 2)
            point.xy = np.ravel(point.xy) + miss
    return copy


def _projected(model: Any, pose: Array, world: Array) -> tuple[Array, Integers]:
    """Places of the points that a pose sees, px, and their rows."""
    local = world @ pose[:3, :3].T + pose[:3, 3]
    front = np.flatnonzero(local[:, 2] > 0.5)
    places = project(lens_of(model.cameras[1]), local[front])
    inside = ((places > 0) & (places < (WIDTH, HEIGHT))).all(1)
    wide = np.hypot(local[front, 0], local[front, 1]) < 0.9 * local[front, 2]
    keep = inside & wide
    return places[keep], front[keep]


def _scene(kind: str, rng: np.random.Generator, points: int) -> tuple[Array, list[Array]]:
    if kind in ("flat flight", "flight over houses"):
        rough = 0.3 if kind == "flat flight" else 6.0
        world = np.column_stack([rng.uniform(-45, 45, (points, 2)), rng.uniform(0, rough, points)])
        east, north = np.meshgrid(np.linspace(-24, 24, 5), np.linspace(-20, 20, 4))
        centres = np.column_stack([east.ravel(), north.ravel(), np.full(east.size, 40.0)])
        centres += rng.normal(0, (0.8, 0.8, 0.4), centres.shape)
        down = np.array([0.0, 0.0, -1.0])
        looks = [down + rng.normal(0, 0.01, 3) for _ in centres]
        return world, [_pose(one, look, (0, 1, 0)) for one, look in zip(centres, looks, strict=True)]
    if kind in ("walk ahead", "walk aside"):
        side = rng.choice([-1.0, 1.0], points) * rng.uniform(2, 6, points)
        world = np.column_stack([side, rng.uniform(3, 40, points), rng.uniform(0, 6, points)])
        if kind == "walk aside":
            world = np.column_stack([rng.uniform(-12, 24, points), rng.uniform(6, 14, points), world[:, 2]])
        steps = np.arange(14) * 1.0
        centres = np.column_stack([np.zeros(14), steps, np.full(14, 1.7)])
        if kind == "walk aside":
            centres = centres[:, [1, 0, 2]]
        centres += rng.normal(0, 0.05, centres.shape)
        looks = [np.array([0.0, 1.0, 0.0]) + rng.normal(0, 0.03, 3) for _ in centres]
        return world, [_pose(one, look, (0, 0, 1)) for one, look in zip(centres, looks, strict=True)]
    world = rng.uniform(-1, 1, (points, 3)) * (1.5, 1.5, 1.0)
    angles = np.linspace(0, 2 * np.pi, 17)[:-1]
    centres = np.column_stack([5 * np.cos(angles), 5 * np.sin(angles), np.full(16, 1.5)])
    centres += rng.normal(0, 0.15, centres.shape)
    looks = [-one + rng.normal(0, 0.1, 3) for one in centres]
    return world, [_pose(one, look, (0, 0, 1)) for one, look in zip(centres, looks, strict=True)]


def _pose(centre: Array, look: Array, up: tuple[float, float, float]) -> Array:
    """cam_from_world [4, 4] of a camera at a place that looks in a direction, its upper edge towards `up`."""
    ahead = look / np.linalg.norm(look)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead])
    pose[:3, 3] = -pose[:3, :3] @ centre
    return pose
