"""A first guess of lenses, board poses and rig from corners alone, for the adjustment to begin at."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from calib.boards.corners import Corners
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.optics.lens import Lens
from imaging.session.records import Board
from imaging.session.view_id import ViewId

FEWEST_VIEWS = 3
"""Views of a board that determine a focal length, if they are tilted."""
_FLAGS = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3


@dataclass(frozen=True, eq=False)
class Start:
    """cam_from_rig and rig_from_board are [4, 4]; isolated: cameras that share no board view with the others.

    An isolated camera has a lens, but no place in the rig; so have its groups of views.
    """

    lenses: dict[str, Lens]
    cam_from_rig: dict[str, Array]
    rig_from_board: dict[int, Array]
    isolated: tuple[str, ...]


def first_guess(
    board: Board, detected: Mapping[ViewId, Corners], sizes: Mapping[str, tuple[int, int]]
) -> Start:
    """Guess from corners; CalibrationError when no camera has views enough.

    detected: corners by view. sizes: (width, height) of each camera's pictures.
    """
    flat = board.corners()
    lenses: dict[str, Lens] = {}
    for name, size in sizes.items():
        of_camera = [corners for view, corners in detected.items() if view.camera == name]
        if len(of_camera) >= FEWEST_VIEWS:
            lenses[name] = _lens(flat, of_camera, size)
    if not lenses:
        most = max((sum(view.camera == name for view in detected) for name in sizes), default=0)
        raise CalibrationError(
            f"No camera sees the board in {FEWEST_VIEWS} frames or more (the best of them in {most}): "
            "show it in about 25 frames, tilted up to 45 degrees, to several cameras at once."
        )
    poses = {
        view: _pose(flat, corners, lenses[view.camera])
        for view, corners in detected.items()
        if view.camera in lenses
    }
    return _joined(lenses, poses, {view: len(corners.ids) for view, corners in detected.items()})


def _lens(flat: Array, views: list[Corners], size: tuple[int, int]) -> Lens:
    objects = [flat[view.ids].astype(np.float32).reshape(-1, 1, 3) for view in views]
    pixels = [(view.points - 0.5).astype(np.float32).reshape(-1, 1, 2) for view in views]
    width, height = size
    matrix = np.array([[max(size), 0.0, width / 2], [0.0, max(size), height / 2], [0.0, 0.0, 1.0]])
    flags = _FLAGS | (cv2.CALIB_FIX_PRINCIPAL_POINT if len(views) < 2 * FEWEST_VIEWS else 0)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # threads add up in the order in which they finish, and no two runs are the same
    try:
        _, matrix, distortion, _, _ = cv2.calibrateCamera(objects, pixels, size, matrix, None, flags=flags)
    finally:
        cv2.setNumThreads(threads)
    return Lens(
        model="SIMPLE_RADIAL",
        width=width,
        height=height,
        fx=float(matrix[0, 0]),
        fy=float(matrix[0, 0]),
        cx=float(matrix[0, 2]) + 0.5,
        cy=float(matrix[1, 2]) + 0.5,
        k1=float(np.ravel(distortion)[0]),
    )


def _pose(flat: Array, corners: Corners, lens: Lens) -> Array:
    """cam_from_board [4, 4] of one view."""
    matrix = np.array([[lens.fx, 0.0, lens.cx - 0.5], [0.0, lens.fy, lens.cy - 0.5], [0.0, 0.0, 1.0]])
    distortion = np.array([lens.k1, 0.0, 0.0, 0.0])
    _, turn, shift = cv2.solvePnP(
        flat[corners.ids], corners.points - 0.5, matrix, distortion, flags=cv2.SOLVEPNP_IPPE
    )
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(turn)[0]
    pose[:3, 3] = np.ravel(shift)
    return pose


def _joined(lenses: dict[str, Lens], poses: dict[ViewId, Array], count: dict[ViewId, int]) -> Start:
    """Cameras placed from camera to camera, along the pairs that share most frames."""
    frames = {name: {view.frame for view in poses if view.camera == name} for name in lenses}
    shared = {
        frozenset(pair): sorted(frames[pair[0]] & frames[pair[1]]) for pair in combinations(sorted(lenses), 2)
    }
    group = max(
        _groups(sorted(lenses), shared),
        key=lambda names: (len(names), sum(len(frames[name]) for name in names)),
    )
    reference = max(sorted(group), key=lambda name: len(frames[name]))
    placed = {reference: np.eye(4)}
    while len(placed) < len(group):
        edges = [
            (len(shared[frozenset((near, far))]), near, far)
            for near in placed
            for far in group
            if far not in placed and shared[frozenset((near, far))]
        ]
        _, near, far = max(edges)
        both = shared[frozenset((near, far))]
        relative = [poses[ViewId(frame, far)] @ np.linalg.inv(poses[ViewId(frame, near)]) for frame in both]
        placed[far] = _middle(relative) @ placed[near]
    boards: dict[int, Array] = {}
    for frame in sorted({view.frame for view in poses if view.camera in placed}):
        views = [ViewId(frame, name) for name in placed]
        best = max((view for view in views if view in poses), key=lambda view: count[view])
        boards[frame] = np.linalg.inv(placed[best.camera]) @ poses[best]
    isolated = tuple(name for name in sorted(lenses) if name not in placed)
    return Start(lenses, placed, boards, isolated)


def _groups(names: list[str], shared: dict[frozenset[str], list[int]]) -> list[list[str]]:
    """The cameras that views of one board connect."""
    groups: list[list[str]] = []
    remaining = set(names)
    for name in names:
        if name not in remaining:
            continue
        group, queue = [], deque([name])
        remaining.discard(name)
        while queue:
            here = queue.popleft()
            group.append(here)
            near = sorted(other for other in remaining if shared[frozenset((here, other))])
            remaining -= set(near)
            queue.extend(near)
        groups.append(group)
    return groups


def _middle(motions: list[Array]) -> Array:
    """The motion that is nearest to all others: one view with a flipped pose must not spoil the rest."""
    stack = np.stack(motions)
    scale = max(float(np.median(np.linalg.norm(stack[:, :3, 3], axis=1))), 1e-9)
    turns = np.linalg.norm(stack[:, None, :3, :3] - stack[None, :, :3, :3], axis=(2, 3))
    shifts = np.linalg.norm(stack[:, None, :3, 3] - stack[None, :, :3, 3], axis=2) / scale
    return np.asarray(stack[int(np.argmin(np.median(turns + shifts, axis=1)))])
