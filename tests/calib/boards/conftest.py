"""A simulated rig before a board: where the corners truly are, and what cameras would make of them."""

from dataclasses import dataclass

import numpy as np
import pytest

from calib.boards.corners import Corners
from drivers.sim.camera.lens import project
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.scene.board import SimulatedBoard, board_from_rig
from imaging.arrays import Array
from imaging.session.records import Board
from imaging.session.view_id import ViewId

WIDTH, HEIGHT = 960, 720


@dataclass(frozen=True)
class Stage:
    """A rig of four cameras and the board, with what is true of both."""

    rig: SimulatedRig
    shown: SimulatedBoard
    board: Board

    @property
    def sizes(self) -> dict[str, tuple[int, int]]:
        return {mount.name: (WIDTH, HEIGHT) for mount in self.rig.mounts}

    def cam_from_board(self, camera: int, frame: int) -> Array:
        mounted = [mount.cam_from_rig for mount in self.rig.mounts]
        held = board_from_rig(self.shown, self.rig.seed, frame, self.rig.mounts[0].optics.lens, mounted)
        return np.asarray(mounted[camera] @ np.linalg.inv(held))

    def corners(self, camera: int, frame: int) -> Array:
        """Places of all corners in the image, px [N, 2]; NaN outside of it."""
        pose = self.cam_from_board(camera, frame)
        local = self.board.corners() @ pose[:3, :3].T + pose[:3, 3]
        points = project(self.rig.mounts[camera].optics.lens, local)
        inside = (local[:, 2] > 0) & (points > 5).all(1) & (points < (WIDTH - 5, HEIGHT - 5)).all(1)
        return np.where(inside[:, None], points, np.nan)

    def detected(self, frames: int, noise: float = 0.06, wrong: float = 0.0) -> dict[ViewId, Corners]:
        """Corners with noise, px a coordinate, a share of them wrong by several pixels."""
        rng = np.random.default_rng(self.rig.seed)
        corners: dict[ViewId, Corners] = {}
        for frame in range(frames):
            for camera, mount in enumerate(self.rig.mounts):
                points = self.corners(camera, frame)
                points = points + rng.normal(0.0, noise, points.shape)
                stray = rng.random(len(points)) < wrong
                points[stray] += rng.normal(0.0, 6.0, (int(stray.sum()), 2))
                ids = np.flatnonzero(np.isfinite(points[:, 0]))
                if len(ids) >= 6:
                    corners[ViewId(frame, mount.name)] = Corners(ids, points[ids])
        return corners

    def relative(self, name: str, reference: str) -> Array:
        """True place of a camera as seen from another, [4, 4]."""
        of = {mount.name: np.asarray(mount.cam_from_rig) for mount in self.rig.mounts}
        return np.asarray(of[name] @ np.linalg.inv(of[reference]))


def stage_of(seed: int, lens: str = "normal") -> Stage:
    shown = SimulatedBoard()
    rig = simulate("demo", seed, width=WIDTH, height=HEIGHT, lens=lens)
    return Stage(rig, shown, Board(**shown.description()))


@pytest.fixture(scope="session")
def stage() -> Stage:
    return stage_of(3)
