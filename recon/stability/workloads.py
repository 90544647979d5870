"""Gaussians to render: the two scenes of every rasteriser table, seeded.

object: a table top with five spheres, seen from outside. room: a room with boxes, seen from inside; most
of it is behind the camera. Gaussians lie on the surfaces, flat along the normal, with a deviation of 0.6
of their spacing (lognormal, 0.35) and opacities of 0.1 to 1.
"""

import numpy as np
import torch

from imaging.arrays import Array
from recon.splat import SplatCamera


def workload(name: str, count: int, seed: int = 0) -> list[torch.Tensor]:
    """means, quats, scales, opacities, colours: float32, requiring gradients."""
    rng = np.random.default_rng(seed)
    points, normals, area = {"object": _object, "room": _room}[name](count, rng)
    spacing = np.sqrt(area / count)
    scales = 0.6 * spacing * np.exp(0.35 * rng.normal(size=(count, 3)))
    scales[:, 2] *= 0.15
    # The rotation that takes z to the normal: (1 + n_z, z x n), or a half turn where n = -z.
    quats = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(count)], axis=1)
    quats[np.linalg.norm(quats, axis=1) < 1e-6] = (0, 1, 0, 0)
    values = (points, quats, scales, 0.1 + 0.9 * rng.beta(2, 1, count), rng.uniform(0, 1, (count, 3)))
    return [torch.tensor(value, dtype=torch.float32).requires_grad_() for value in values]


def _object(count: int, rng: np.random.Generator) -> tuple[Array, Array, float]:
    flat = count // 2
    points = [np.concatenate([rng.uniform(-1, 1, (flat, 2)), np.zeros((flat, 1))], axis=1)]
    normals, area = [np.tile([0.0, 0.0, 1.0], (flat, 1))], 4.0
    for ball in np.array_split(np.arange(count - flat), 5):
        direction = rng.normal(size=(len(ball), 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        radius = rng.uniform(0.2, 0.35)
        points.append(np.array([*rng.uniform(-0.6, 0.6, 2), radius]) + radius * direction)
        normals.append(direction)
        area += 4 * np.pi * radius**2
    return np.concatenate(points), np.concatenate(normals), area


def _room(count: int, rng: np.random.Generator) -> tuple[Array, Array, float]:
    sizes = [(6.0, 5.0, 3.0)] + [(0.5, 0.5, 1.0)] * 6
    corners = [(-3.0, -2.5, 0.0)] + [(*rng.uniform([-2.8, -2.3], [2.3, 1.8]), 0.0) for _ in range(6)]
    faces = []
    for (a, b, c), corner in zip(sizes, corners, strict=True):
        for axis, area in ((0, b * c), (1, a * c), (2, a * b)):
            faces += [((a, b, c), corner, axis, side, area) for side in (0, 1)]
    areas = np.array([face[4] for face in faces])
    choice = rng.choice(len(faces), count, p=areas / areas.sum())
    points, normals = np.empty((count, 3)), np.zeros((count, 3))
    for number, (size, corner, axis, side, _) in enumerate(faces):
        mine = choice == number
        place = rng.uniform(0, 1, (mine.sum(), 3))
        place[:, axis] = side
        points[mine] = np.array(corner) + place * size
        normals[mine, axis] = 2 * side - 1
    return points, normals, float(areas.sum())


def view(name: str, width: int, height: int, turn: float = 0.3) -> SplatCamera:
    """A camera of 65 degrees: at the object from outside, or from the middle of the room.

    Args:
        name: `object` or `room`, as of `workload`.
        width: Of the picture, px; the angle of 65 degrees is across it.
        height: Of the picture, px.
        turn: Direction about the vertical, radians: from which the object is seen, or in which the room is.

    Returns:
        The camera, without distortion.
    """
    around = np.array([np.cos(turn), np.sin(turn)])
    if name == "object":
        eye, target = np.array([*(2.2 * around), 1.3]), np.array([0.0, 0.0, 0.15])
    else:
        eye, target = np.array([0.0, 0.0, 1.5]), np.array([*(2.0 * around), 1.2])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    motion = np.eye(4)
    motion[:3, :3] = [right, np.cross(forward, right), forward]
    motion[:3, 3] = -motion[:3, :3] @ eye
    focal = width / 2 / np.tan(np.radians(65 / 2))
    return SplatCamera(motion, focal, focal, width / 2, height / 2, width, height)
