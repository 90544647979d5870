"""A ChArUco board held before the rig, and what a camera sees of it: flat, matt, evenly lit.

SimulatedBoard axes are OpenCV's: the origin at the outer corner of the chessboard's first square, x along its
rows, y down, z into the board; metres.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.sim.camera.lens import unproject
from drivers.sim.seeds import generator
from imaging.arrays import Array, Array32
from imaging.optics.lens import Lens

_TEXELS = 48
"""Along a square. Edges of squares and markers lie between texels, so the picture is exact."""

_MARGIN = 0.25
"""Width of the blank border of the board, in squares."""

_PAPER, _INK, _BACKGROUND = 0.85, 0.04, 0.20
"""Diffuse reflectances."""

_NEAR, _FAR, _TILT, _ROLL, _ASIDE = 1.0, 1.9, 45.0, 40.0, 0.6
"""m, m, degrees, degrees; the largest distance of the middle from the axis, in half fields of view."""


@dataclass(frozen=True)
class SimulatedBoard:
    """columns, rows: of squares; square, marker: their sides, m; dictionary: OpenCV's name of it.

    As large as a sheet of A0, for cameras of few pixels.
    """

    columns: int = 7
    rows: int = 5
    square: float = 0.15
    marker: float = 0.1125
    dictionary: str = "DICT_4X4_50"

    def description(self) -> dict[str, Any]:
        """Return what a user would write down about the board."""
        return {
            "columns": self.columns,
            "rows": self.rows,
            "square": self.square,
            "marker": self.marker,
            "dictionary": self.dictionary,
        }

    def reflectance(self) -> Array:
        """Reflectance of every texel of the board with its border, float64 [rows, columns]."""
        import cv2  # which takes a while to load, and most of what imports this draws no board

        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        size = (self.columns, self.rows)
        board = cv2.aruco.CharucoBoard(size, self.square, self.marker, dictionary)
        picture = board.generateImage((self.columns * _TEXELS, self.rows * _TEXELS))
        border = round(_MARGIN * _TEXELS)
        return np.where(np.pad(picture, border, constant_values=255) > 127, _PAPER, _INK)

    def render(self, lens: Lens, cam_from_board: Array, samples: int) -> Array32:
        """Radiance of board and background where white paper that reflects all has 1, float32 [H, W]."""
        texture = self.reflectance()
        border = round(_MARGIN * _TEXELS)
        board_from_cam = np.linalg.inv(cam_from_board)
        turn, eye = board_from_cam[:3, :3], board_from_cam[:3, 3]
        image = np.empty((lens.height, lens.width), np.float32)
        across = (np.arange(lens.width * samples) + 0.5) / samples
        # A few rows at a time: all rays of a large picture would not fit into memory.
        for first in range(0, lens.height, 32):
            last = min(first + 32, lens.height)
            down = first + (np.arange((last - first) * samples) + 0.5) / samples
            rays = unproject(lens, np.stack(np.meshgrid(across, down), axis=-1)) @ turn.T
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = -eye[2] / rays[..., 2]
                at = (eye[:2] + reach[..., None] * rays[..., :2]) * (_TEXELS / self.square) + border
            inside = (reach > 0) & np.all((at >= 0) & (at < texture.shape[::-1]), axis=-1)
            cell = np.where(inside[..., None], at, 0.0).astype(np.intp)
            colours = np.where(inside, texture[cell[..., 1], cell[..., 0]], _BACKGROUND)
            image[first:last] = colours.reshape(last - first, samples, lens.width, samples).mean((1, 3))
        return image


def board_from_rig(
    board: SimulatedBoard, seed: int, frame: int, lens: Lens, cam_from_rig: list[Array]
) -> Array:
    """Pose of the board at a frame, float64 [4, 4]: before all cameras, often partly out of view.

    The face turns up to 45 degrees away from the line of sight. lens: of any of the cameras.
    """
    noise = generator(seed, "board", frame)
    rig_from_plate = _middle(cam_from_rig)
    depth = math.exp(noise.uniform(math.log(_NEAR), math.log(_FAR)))
    aside = noise.uniform(-_ASIDE, _ASIDE, 2) * (lens.width / lens.fx / 2, lens.height / lens.fy / 2)
    sight = np.array((*aside, 1.0))
    tilt, about = math.radians(noise.uniform(0.0, _TILT)), noise.uniform(0.0, 2 * math.pi)
    roll = math.radians(noise.uniform(-_ROLL, _ROLL))
    pose = np.eye(4)
    pose[:3, :3] = (
        _facing(sight)
        @ _turn(np.array((math.cos(about), math.sin(about), 0.0)), tilt)
        @ _turn(np.array((0.0, 0.0, 1.0)), roll)
    )
    middle = np.array((board.columns, board.rows, 0.0)) * board.square / 2
    pose[:3, 3] = depth * sight - pose[:3, :3] @ middle
    return np.asarray(np.linalg.inv(rig_from_plate @ pose))


def _middle(cam_from_rig: list[Array]) -> Array:
    """rig_from_plate of a camera amidst the cameras that looks where they look on average."""
    cameras = np.linalg.inv(np.stack(cam_from_rig))
    pose = np.eye(4)
    forward = cameras[:, :3, 2].mean(axis=0)
    pose[:3, :3] = _axes(forward, cameras[:, :3, 1].mean(axis=0))
    pose[:3, 3] = cameras[:, :3, 3].mean(axis=0)
    return pose


def _facing(sight: Array) -> Array:
    """Axes of something seen squarely along a line of sight."""
    return _axes(sight, np.array((0.0, 1.0, 0.0)))


def _axes(forward: Array, down: Array) -> Array:
    """Right, down and forward as the columns of a rotation."""
    z = forward / np.linalg.norm(forward)
    x = np.cross(down, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _turn(axis: Array, angle: float) -> Array:
    """Rotation by Rodrigues' formula, about a unit axis."""
    x, y, z = axis
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross))
