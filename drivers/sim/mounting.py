"""Geometry and motion of a simulated rig: four cameras on one plate, the plate on an arc.

The plate's cameras stand half an arc step apart, so that all views together form two even rows. One camera
on a nodal head turns about its entrance pupil instead, in a level row and two that look up and down. Before
a turntable and over a light dome the plate stands still.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from drivers.sim.camera.optics import Optics
from drivers.sim.scene.court import EYE
from drivers.sim.scene.tabletop import TARGET
from drivers.sim.scene.turntable import MIDDLE
from drivers.sim.seeds import generator
from imaging.arrays import Array
from imaging.colour.spaces import REC709_FROM_XYZ
from imaging.optics.lens import Lens
from imaging.sensor.cfa import BAYER, Cfa, Tile, as_tile
from imaging.sensor.mosaic import Matrix, as_matrix

ARC_STEP = 11.0
"""Degrees between neighbouring frames."""
_RADIUS, _HEIGHT, _MIDDLE = 2.30, 1.35, 225.0  # m, m, degrees: the arc faces the corner of the room
_PITCH = 56.0
"""Degrees above and below the horizon at which the upper and the lower row of a nodal head look."""
TURN_SPREAD = 0.2
"""Standard error of the stops of a turntable, degrees."""
_STAND = (0.55, -0.28, 0.50)
"""Place of the first camera before a turntable, m."""
LAMP_SPREAD = 0.003
"""Relative standard error of the light of a dome's lamp."""
_OVER_DOME = (0.0, -0.5, 0.0)
"""Place of the first camera before the relief in a dome, m."""
LensKind = Literal["normal", "fisheye"]
_BASELINE = (0.22, 0.36)  # m between the cameras of the plate, across and up


@dataclass(frozen=True)
class Mount:
    """One camera as it was built and mounted; all that a seed decides about it but its noise."""

    name: str
    serial: str
    optics: Optics
    cam_from_rig: Array
    cfa: Cfa
    camera_from_xyz: Matrix | None
    unit_gain: float
    unit_noise: float
    black: Tile


def look_at(eye: npt.ArrayLike, target: npt.ArrayLike, roll: float = 0.0) -> Array:
    """cam_from_world [4, 4] of a camera at `eye` facing `target`, z up, turned by `roll` radians."""
    place = np.asarray(eye, np.float64)
    forward = np.asarray(target, np.float64) - place
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right)
    down = np.cross(forward, right)
    cos, sin = math.cos(roll), math.sin(roll)
    pose = np.eye(4)
    pose[:3, :3] = (cos * right + sin * down, cos * down - sin * right, forward)
    pose[:3, 3] = -pose[:3, :3] @ place
    return pose


def _plate_from_world(seed: int, frames: int, frame: int) -> Array:
    """Return where the plate is; the arm misses its place by some millimetres and a fraction of a degree."""
    noise = generator(seed, "arm", frame)
    angle = math.radians(_MIDDLE + ARC_STEP * (frame - (frames - 1) / 2) + noise.uniform(-0.5, 0.5))
    eye = np.array((_RADIUS * math.cos(angle), _RADIUS * math.sin(angle), _HEIGHT))
    eye += noise.uniform(-0.01, 0.01, 3)
    return look_at(eye, TARGET + noise.uniform(-0.02, 0.02, 3), noise.uniform(-0.01, 0.01))


def _cam_from_plate(seed: int, index: int) -> Array:
    noise = generator(seed, "mount", index)
    across, up = (-1.0, 1.0)[index % 2], (1.0, -1.0)[index // 2 % 2]
    # Plate axes are those of a camera: x right, y down, z towards the scene.
    place = np.array((across * _BASELINE[0] / 2, up * _BASELINE[1] / 2, 0.0)) + noise.uniform(
        -0.005, 0.005, 3
    )
    target = np.array((0.08 * across, 0.03 * up, math.hypot(_RADIUS, _HEIGHT - TARGET[2])))
    target += noise.uniform(-0.02, 0.02, 3)
    # look_at wants z up, the plate has y down.
    plate_from_upright = np.array(((1.0, 0, 0, 0), (0, 0, -1.0, 0), (0, 1.0, 0, 0), (0, 0, 0, 1.0)))
    upright_from_plate = plate_from_upright.T
    upright = look_at(
        upright_from_plate[:3, :3] @ place, upright_from_plate[:3, :3] @ target, noise.uniform(-0.02, 0.02)
    )
    return np.asarray(upright @ upright_from_plate)


def rig_from_world(seed: int, frames: int, frame: int) -> Array:
    """Pose of the rig, whose axes are those of its first camera, float64 [4, 4]."""
    return np.asarray(_cam_from_plate(seed, 0) @ _plate_from_world(seed, frames, frame))


def head_from_world(seed: int, frames: int, frame: int) -> Array:
    """Pose of a camera on a nodal head, whose clicks are some tenths of a degree off, float64 [4, 4].

    Half of the frames look level, and a quarter each up and down.
    """
    noise = generator(seed, "head", frame)
    level, up = frames - 2 * (frames // 4), frames // 4
    row, first, count = (0.0, 0, level) if frame < level else (_PITCH, level, up)
    if frame >= level + up:
        row, first, count = -_PITCH, level + up, up
    turn = 2 * math.pi * (frame - first + (0.5 if first else 0.0)) / count
    turn += math.radians(noise.uniform(-0.3, 0.3))
    pitch = math.radians(row + noise.uniform(-0.3, 0.3))
    ahead = (math.cos(pitch) * math.cos(turn), math.cos(pitch) * math.sin(turn), math.sin(pitch))
    return look_at(EYE, np.add(EYE, ahead), math.radians(noise.uniform(-0.2, 0.2)))


def table_turn(seed: int, frames: int, frame: int) -> float:
    """Degrees by which a turntable really stands further than at first: some tenths off its stops."""
    missed = generator(seed, "table", frame).normal(0.0, TURN_SPREAD) if frame else 0.0
    return 360.0 * frame / frames + missed


def before_turntable(seed: int, frames: int, frame: int) -> Array:
    """Pose of a rig that stands still, in the axes of what turns before it, float64 [4, 4]."""
    angle = math.radians(table_turn(seed, frames, frame))
    room_from_world = np.eye(4)
    room_from_world[:2, :2] = (math.cos(angle), -math.sin(angle)), (math.sin(angle), math.cos(angle))
    return np.asarray(look_at(_STAND, MIDDLE, 0.01) @ room_from_world)


def lamp_factor(seed: int, frame: int) -> float:
    """Factor by which the lamp at a frame of a light dome is brighter than is stated."""
    return 1.0 + float(generator(seed, "lamp", frame).normal(0.0, LAMP_SPREAD))


def over_dome(seed: int, frames: int, frame: int) -> Array:
    """Pose of a rig that looks at the relief in a light dome, float64 [4, 4]."""
    return look_at(_OVER_DOME, (0.0, 0.0, 0.0))


def mounts(
    seed: int,
    cameras: int,
    width: int,
    height: int,
    kind: Literal["raw", "ldr"],
    lens: LensKind = "normal",
    cfa: Cfa | None = None,
) -> tuple[Mount, ...]:
    """The cameras of a rig.

    Args:
        seed: Seed of lenses, colours and sensors.
        cameras: Number of cameras.
        width: Width of their pictures, px.
        height: Height of their pictures, px.
        kind: Kind of their pictures: RAW or photographs.
        lens: Kind of their lenses.
        cfa: Colour of the photosites of all, which each begins at a place of its own; None: a Bayer one.

    Returns:
        The cameras as they are built and mounted to each other.
    """
    rig_from_plate = _cam_from_plate(seed, 0)
    plate_from_rig: Array = np.asarray(np.linalg.inv(rig_from_plate), np.float64)
    return tuple(
        _mount(seed, index, width, height, kind, lens, plate_from_rig, cfa) for index in range(cameras)
    )


def _mount(
    seed: int,
    index: int,
    width: int,
    height: int,
    kind: Literal["raw", "ldr"],
    lens_kind: LensKind,
    plate_from_rig: Array,
    table: Cfa | None,
) -> Mount:
    serial = f"SIM-{kind.upper()}-{index + 1:03d}"
    noise = generator(seed, serial, "build")
    focal = width * noise.uniform(0.97, 1.03)
    lens = Lens(
        model="OPENCV",
        width=width,
        height=height,
        fx=focal,
        fy=focal,
        cx=width * (0.5 + noise.uniform(-0.0005, 0.0005)),
        cy=height * 0.5 + width * noise.uniform(-0.0005, 0.0005),
        k1=noise.uniform(-0.08, -0.05),
        k2=noise.uniform(-0.003, 0.003),
        p1=noise.uniform(-1e-4, 1e-4),
        p2=noise.uniform(-1e-4, 1e-4),
    )
    if lens_kind == "fisheye":
        lens = _fisheye(lens, generator(seed, serial, "fisheye"))
    colour = _colour(noise)
    cfa = BAYER[int(noise.integers(4))] if index else Cfa.RGGB
    if table is not None:
        cfa = table.cropped(index, 2 * index)
        colour = _with_white(colour, cfa, generator(seed, serial, "white"))
    optics = Optics(
        lens=lens,
        vignetting=(
            -0.32 + noise.uniform(-0.03, 0.03),
            0.09 + noise.uniform(-0.02, 0.02),
            -0.02 + noise.uniform(-0.01, 0.01),
        ),
        camera_from_rec709=colour,
        gain=1.0 + noise.uniform(-0.02, 0.02),
    )
    black = as_tile(noise.integers(-2, 3, 4).reshape(2, 2))
    return Mount(
        name=f"cam{index}",
        serial=serial,
        optics=optics,
        cam_from_rig=np.eye(4) if index == 0 else _cam_from_plate(seed, index) @ plate_from_rig,
        cfa=cfa,
        camera_from_xyz=None if cfa.mono else as_matrix(colour @ REC709_FROM_XYZ),
        unit_gain=noise.uniform(0.985, 1.015),
        unit_noise=noise.uniform(0.93, 1.07),
        black=black,
    )


def _fisheye(lens: Lens, noise: np.random.Generator) -> Lens:
    """A lens of some 120 degrees across the diagonal, at the same principal point."""
    focal = lens.width * noise.uniform(0.57, 0.59)
    return Lens(
        model="OPENCV_FISHEYE",
        width=lens.width,
        height=lens.height,
        fx=focal,
        fy=focal,
        cx=lens.cx,
        cy=lens.cy,
        k1=noise.uniform(0.02, 0.04),
        k2=noise.uniform(-0.02, -0.01),
        k3=noise.uniform(0.0, 0.005),
        k4=noise.uniform(-0.001, 0.0),
    )


def _with_white(colour: Array, cfa: Cfa, noise: np.random.Generator) -> Array:
    """The rows of a sensor with this table: one without a filter sees nearly the sum of the others.

    Mono is as sensitive as green, to a white surface.
    """
    white = noise.uniform(0.85, 1.15, 3) @ colour
    if cfa.mono:
        return np.asarray(white[None] / white.sum())
    return np.concatenate([colour, white[None]]) if "W" in cfa.letters else colour


def _colour(noise: np.random.Generator) -> Array:
    """A camera's spectral sensitivities as a matrix on Rec.709, all entries positive."""
    rows = np.array(((0.72, 0.24, 0.04), (0.16, 0.72, 0.12), (0.03, 0.21, 0.76)))
    rows *= np.exp(noise.uniform(-0.12, 0.12, (3, 3)))
    rows /= rows.sum(axis=1, keepdims=True)
    sensitivity = np.array((noise.uniform(0.50, 0.62), 1.0, noise.uniform(0.62, 0.76)))
    return np.asarray(rows * sensitivity[:, None])
