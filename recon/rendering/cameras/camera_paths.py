"""Cameras that move: round what the photographs show, or through where they were taken.

A path is drawn by a lens without distortion, of the focal length and the upright picture of the first view.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

from imaging.arrays import Array
from imaging.errors import InputError
from imaging.optics.pose import upwards
from recon.rendering.request import named_frames
from recon.result.model import SceneView
from recon.result.scene import Scene
from recon.splat import SplatCamera

_SURROUNDED = np.radians(120.0)
"""A gap between neighbouring views, as seen from what they look at, that an orbit still goes through."""
_DENSE = 64
"""Samples of a piece of a spline by which its length is measured."""


@dataclass(frozen=True)
class CameraPath:
    """Cameras in order, in the world of the calibration; numbers: of their frames, empty: from any.

    note: which camera of a file they are, and in which coordinates that is; empty where nothing was chosen.
    """

    name: str
    cameras: tuple[SplatCamera, ...]
    numbers: tuple[int, ...] = ()
    note: str = ""


def named_path(scene: Scene, text: str) -> CameraPath | None:
    """The path through a scene that a name stands for; None and InputError as `named_frames`."""
    named = named_frames(text)
    if named is None:
        return None
    name, frames = named
    cameras = orbit(scene, frames) if name == "orbit" else spline(scene, frames)
    return CameraPath(name, tuple(cameras))


def orbit(scene: Scene, frames: int) -> list[SplatCamera]:
    """Orbit the common target of the views, at their median distance and height, upright.

    Where they leave more than a third of the circle out, to and fro over what they cover. It ends one frame
    before it would be where it began, so that it can be repeated.
    """
    motions = [view.cam_from_world.matrix() for view in scene.views]
    centres, target = _centres(motions), _looked_at(motions)
    up = upwards([view.upright for view in scene.views])
    away = centres - target
    height = float(np.median(away @ up))
    level = away - np.outer(away @ up, up)
    radius = float(np.median(np.linalg.norm(level, axis=1)))
    if min(radius, float(np.linalg.norm(np.ptp(centres, axis=0)))) < 1e-9 * (1 + np.abs(centres).max()):
        raise InputError("All views of the scene have the same position, so there is no orbit.")
    ahead = level[int(np.argmax(np.linalg.norm(level, axis=1)))]
    ahead /= np.linalg.norm(ahead)
    side = np.cross(up, ahead)
    angles = np.arctan2(level @ side, level @ ahead)
    phase = 2 * math.pi * np.arange(frames) / frames
    turns = _swing(angles, phase)
    places = target + height * up + radius * (np.outer(np.cos(turns), ahead) + np.outer(np.sin(turns), side))
    lens = lens_of_path(scene.views)
    return [placed(lens, place, _looking(target - place, up)) for place in places]


def _swing(angles: Array, phase: Array) -> Array:
    """Angles of an orbit at phases of it: all round, or to and fro between the ends of a gap."""
    ordered = np.sort(angles)
    gaps = np.diff(np.append(ordered, ordered[0] + 2 * math.pi))
    widest = int(np.argmax(gaps))
    if gaps[widest] <= _SURROUNDED:
        return np.asarray(ordered[0] + phase)
    first = ordered[(widest + 1) % len(ordered)]
    covered = 2 * math.pi - gaps[widest]
    return np.asarray(first + covered * (0.5 - 0.5 * np.cos(phase)))


def spline(scene: Scene, frames: int) -> list[SplatCamera]:
    """Interpolate the places of the views of the camera that took most, in their order, at even speed.

    Those of all cameras, where none took three. Positions: Catmull-Rom, centripetal (Yuksel, Schaefer and
    Keyser, "Parameterization and applications of Catmull-Rom curves", 2011); turns: a cubic spline of the
    rotations of upright pictures.
    """
    views = _route(scene.views)
    motions = [view.upright for view in views]
    centres = _centres(motions)
    turns = Rotation.from_matrix([motion[:3, :3].T for motion in motions])
    distance = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    angle = (turns[:-1].inv() * turns[1:]).magnitude() if len(views) > 1 else np.zeros(0)
    size = float(np.linalg.norm(np.ptp(centres, axis=0))) or 1.0
    moved = np.append(True, (distance > 1e-9 * size) | (angle > 1e-9))
    centres, turns = centres[moved], turns[moved]
    if len(centres) < 2:
        raise InputError("All views of the scene have the same position, so there is no spline through them.")
    distance = np.linalg.norm(np.diff(centres, axis=0), axis=1) / size
    angle = (turns[:-1].inv() * turns[1:]).magnitude()
    knots = np.append(0.0, np.cumsum(np.sqrt(distance + 1e-3 * angle)))
    dense = np.linspace(0.0, knots[-1], _DENSE * len(knots))
    steps = np.linalg.norm(np.diff(_catmull_rom(centres, knots, dense), axis=0), axis=1) / size
    way = np.append(0.0, np.cumsum(steps + 1e-3 * knots[-1] / len(dense)))
    at = np.interp(np.linspace(0.0, way[-1], frames), way, dense)
    lens = lens_of_path(views)
    places, turned = _catmull_rom(centres, knots, at), RotationSpline(knots, turns)(at).as_matrix()
    return [placed(lens, place, turn) for place, turn in zip(places, turned, strict=True)]


def _catmull_rom(points: Array, knots: Array, at: Array) -> Array:
    """Places [M, 3] on the curve through points [N, 3] at knots, by the pyramid of Barry and Goldman."""
    first, last = 2 * points[0] - points[1], 2 * points[-1] - points[-2]
    points = np.vstack([first, points, last])
    knots = np.concatenate([[2 * knots[0] - knots[1]], knots, [2 * knots[-1] - knots[-2]]])
    piece = np.clip(np.searchsorted(knots, at, side="right") - 1, 1, len(knots) - 3)
    level = [points[piece + step] for step in (-1, 0, 1, 2)]
    times = [knots[piece + step][:, None] for step in (-1, 0, 1, 2)]
    x = at[:, None]

    def between(a: Array, b: Array, start: Array, end: Array) -> Array:
        return np.asarray(((end - x) * a + (x - start) * b) / (end - start))

    level = [between(level[i], level[i + 1], times[i], times[i + 1]) for i in range(3)]
    level = [between(level[i], level[i + 1], times[i], times[i + 2]) for i in range(2)]
    return between(level[0], level[1], times[1], times[2])


def _route(views: Sequence[SceneView]) -> list[SceneView]:
    """The views of the camera that took most of them, by frame; all, where that is fewer than three."""
    counts = {view.camera: 0 for view in views}
    for view in views:
        counts[view.camera] += 1
    most = max(counts, key=lambda camera: counts[camera])
    return [view for view in views if view.camera == most] if counts[most] >= 3 else list(views)


def lens_of_path(views: Sequence[SceneView]) -> SplatCamera:
    """A camera at the origin without distortion, for the upright picture of the first view; of a fisheye 90
    degrees wide.
    """
    lens = views[0].lens.as_held(views[0].orientation)
    focal = lens.width / 2 if lens.fisheye else math.sqrt(lens.fx * lens.fy)
    return SplatCamera(
        np.eye(4), focal, focal, lens.width / 2, lens.height / 2, width=lens.width, height=lens.height
    )


def placed(lens: SplatCamera, place: Array, world_from_camera: Array) -> SplatCamera:
    """A camera at a place [3], turned by a rotation [3, 3] from its axes, OpenCV's, to the world's."""
    motion = np.eye(4)
    motion[:3, :3] = world_from_camera.T
    motion[:3, 3] = -world_from_camera.T @ place
    return replace(lens, cam_from_world=motion)


def _looking(ahead: Array, up: Array) -> Array:
    """World-from-camera rotation [3, 3] of an upright camera that looks ahead; OpenCV's axes."""
    z = ahead / np.linalg.norm(ahead)
    x = np.cross(z, up)
    if np.linalg.norm(x) < 1e-9:  # straight up or down
        x = np.cross(z, np.roll(up, 1))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _centres(motions: Sequence[Array]) -> Array:
    return np.array([-motion[:3, :3].T @ motion[:3, 3] for motion in motions])


def level_axes(views: Sequence[SceneView]) -> Array:
    """World axes of a level map, float64 [3, 3], rows of unit length: left of where the views look, up, and
    where they look, as far as that is level; right-handed."""
    motions = [view.cam_from_world.matrix() for view in views]
    up = upwards([view.upright for view in views])
    ahead = np.sum([motion[2, :3] for motion in motions], axis=0)
    ahead = ahead - (ahead @ up) * up
    if np.linalg.norm(ahead) < 1e-6 * len(motions):  # all round
        ahead = np.cross(up, np.roll(up, 1))
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(up, ahead), up, ahead])


def _looked_at(motions: Sequence[Array]) -> Array:
    """The point that is nearest to the axes of all cameras, in front of them on the average.

    Where the axes hardly differ in direction, it is as far ahead of their middle as the cameras lie apart.
    """
    centres, axes = _centres(motions), np.array([motion[2, :3] for motion in motions])
    across = np.eye(3)[None] - axes[:, :, None] * axes[:, None, :]
    system = across.sum(axis=0)
    middle = centres.mean(axis=0)
    if np.linalg.cond(system) < 1e4:
        point = np.linalg.solve(system, np.einsum("nij,nj->i", across, centres))
        if np.median(np.einsum("nj,nj->n", axes, point - centres)) > 0:
            return np.asarray(point)
    reach = float(np.linalg.norm(centres - middle, axis=1).max()) or 1.0
    ahead = axes.sum(axis=0)
    return np.asarray(middle + reach * ahead / (np.linalg.norm(ahead) or 1.0))
