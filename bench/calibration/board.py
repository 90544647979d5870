"""Board sessions for bench/calibration/poses.py: true corners with noise, or pictures and the detector."""

import time
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from bench.calibration.pose_error import degrees_of
from calib.boards.corners import Corners, find_all
from calib.boards.measure import Group, solve_group
from drivers.sim.camera.lens import project
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.scene.board import SimulatedBoard, board_from_rig
from imaging.arrays import Array, Bytes
from imaging.progress import unreported
from imaging.session.records import Board
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FRAMES, NOISE = 960, 720, 25, 0.06
EDGE = 5.0
"""px; no detector finds a corner nearer to the edge."""
FEWEST = 6
SHOWN = SimulatedBoard()
BOARD = Board(**SHOWN.description())


def rig_of(seed: int) -> SimulatedRig:
    return simulate("demo", seed, width=WIDTH, height=HEIGHT)


def cam_from_board(rig: SimulatedRig, camera: int, frame: int) -> Array:
    mounted = [mount.cam_from_rig for mount in rig.mounts]
    held = board_from_rig(SHOWN, rig.seed, frame, rig.mounts[0].optics.lens, mounted)
    return np.asarray(mounted[camera] @ np.linalg.inv(held))


def corners(rig: SimulatedRig, frames: int) -> dict[ViewId, Corners]:
    """True corners, each coordinate off by NOISE px (normal), of all views that show FEWEST of them."""
    rng = np.random.default_rng([rig.seed, 0xB0A4D])
    projected = {}
    for frame in range(frames):
        for camera, mount in enumerate(rig.mounts):
            pose = cam_from_board(rig, camera, frame)
            local = BOARD.corners() @ pose[:3, :3].T + pose[:3, 3]
            points = project(mount.optics.lens, local)
            inside = (local[:, 2] > 0) & np.all((points > EDGE) & (points < (WIDTH - EDGE, HEIGHT - EDGE)), 1)
            if inside.sum() >= FEWEST:
                points = points + rng.normal(0, NOISE, points.shape)
                projected[ViewId(frame, mount.name)] = Corners(np.flatnonzero(inside), points[inside])
    return projected


def detected(rig: SimulatedRig, frames: int) -> dict[ViewId, Corners]:
    """Corners that the detector finds in pictures with noise of two codes."""

    def picture(view: ViewId) -> Bytes:
        camera = names.index(view.camera)
        light = SHOWN.render(
            rig.mounts[camera].optics.lens, cam_from_board(rig, camera, view.frame), samples=2
        )
        noise = np.random.default_rng([rig.seed, camera, view.frame]).normal(0, 2, light.shape)
        return np.clip(200 * light + noise, 0, 255).astype(np.uint8)

    names = [mount.name for mount in rig.mounts]
    views = [ViewId(frame, name) for name in names for frame in range(frames)]
    pictures = {view: picture(view) for view in views}
    return find_all(BOARD, views, lambda view: pictures[view], unreported)[0]


def relative(rig: SimulatedRig, poses: Mapping[str, Array]) -> list[tuple[str, float, float]]:
    """Error of each camera but the reference: degrees and mm between its true and its estimated place."""
    true = {mount.name: np.asarray(mount.cam_from_rig) for mount in rig.mounts}
    reference = next(name for name, pose in poses.items() if np.allclose(pose, np.eye(4)))
    errors = []
    for name in sorted(poses.keys() - {reference}):
        goal = true[name] @ np.linalg.inv(true[reference])
        here, there = (-pose[:3, :3].T @ pose[:3, 3] for pose in (poses[name], goal))
        turn = degrees_of(poses[name][:3, :3] @ goal[:3, :3].T)
        errors.append((name, turn, 1000 * float(np.linalg.norm(here - there))))
    return errors


def solved(rig: SimulatedRig, corners: Mapping[ViewId, Corners]) -> Group:
    return solve_group(BOARD, corners, {mount.name: (WIDTH, HEIGHT) for mount in rig.mounts}, unreported)


def trial(seed: int, *, rendered: bool = False) -> dict[str, Any]:
    """One session: errors of the rig, in degrees, mm and stated standard errors."""
    rig = rig_of(seed)
    boards = detected(rig, FRAMES) if rendered else corners(rig, FRAMES)
    began = time.perf_counter()
    group = solved(rig, boards)
    row: dict[str, Any] = {"views": len(boards), "corners": sum(len(board.ids) for board in boards.values())}
    row |= {"seconds": time.perf_counter() - began}
    assert group.solved is not None
    assert group.doubt is not None
    errors = relative(rig, group.solved.cam_from_rig)
    row |= {"rotation": [turn for _, turn, _ in errors], "translation": [shift for _, _, shift in errors]}
    row["rotation_ratios"] = [turn / group.doubt.rotation[name] for name, turn, _ in errors]
    row["translation_ratios"] = [shift / 1000 / group.doubt.translation[name] for name, _, shift in errors]
    return row


def peer(seed: int) -> dict[str, Any]:
    """OpenCV on the same corners: each camera calibrated on its own, then all by calibrateMultiview.

    The latter gets the views that show the whole board: of others, whose missing corners are -1 as its own
    sample has them, OpenCV 5.0 makes poses that are off by 20 degrees, with a residual of 1e9 px.
    """
    rig = rig_of(seed)
    boards = corners(rig, FRAMES)
    names = [mount.name for mount in rig.mounts]
    flat = BOARD.corners().astype(np.float32)
    images, mask = [], np.zeros((len(names), FRAMES), np.uint8)
    matrices, distortions = [], []
    for camera, name in enumerate(names):
        detected = {view.frame: board for view, board in boards.items() if view.camera == name}
        points = {frame: (board.points - 0.5).astype(np.float32) for frame, board in detected.items()}
        _, matrix, distortion, _, _ = cv2.calibrateCamera(
            [flat[board.ids] for board in detected.values()],
            list(points.values()),
            (WIDTH, HEIGHT),
            None,
            None,
            flags=cv2.CALIB_FIX_K3,
        )
        matrices.append(matrix)
        distortions.append(distortion)
        whole = {frame for frame, board in detected.items() if len(board.ids) == len(flat)}
        mask[camera, sorted(whole)] = 1
        nowhere = np.full((len(flat), 2), -1.0, np.float32)
        images.append([points[frame] if frame in whole else nowhere for frame in range(FRAMES)])
    began = time.perf_counter()
    try:
        rms, _, _, turns, shifts, *_ = cv2.calibrateMultiview(
            [flat] * FRAMES, images, [(WIDTH, HEIGHT)] * len(names), mask,
            np.zeros((len(names), 1), np.uint8), matrices, distortions, [], [],
            flagsForIntrinsics=np.full(len(names), cv2.CALIB_FIX_K3, np.int32),
            flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        )  # fmt: skip
    except cv2.error as error:
        return {"refused": str(error).splitlines()[-1].strip()}
    poses = {}
    for name, turn, shift in zip(names, turns, shifts, strict=True):
        poses[name] = np.eye(4)
        poses[name][:3, :3] = turn if np.shape(turn) == (3, 3) else cv2.Rodrigues(turn)[0]
        poses[name][:3, 3] = np.ravel(shift)
    errors = relative(rig, poses)
    return {
        "seconds": time.perf_counter() - began,
        "rms": float(rms),
        "rotation": [turn for _, turn, _ in errors],
        "translation": [shift for _, _, shift in errors],
    }
