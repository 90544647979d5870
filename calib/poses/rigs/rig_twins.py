"""Views that stand at a look-alike of their place, by what only a rig has: a mounting that does not change.

Pictures alone may place a camera before the wrong one of two sides that look alike. Cameras that are mounted
to each other and fire at once have the same relative pose in every frame; where one frame has another, one of
its views stands wrongly.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from calib.poses.checks.brightness_steps import Pairs
from imaging.arrays import Array
from imaging.session.view_id import ViewId

FEWEST_FRAMES = 4
"""Frames that show two cameras, below which none of them is usual."""
NEAR, FAR = 5.0, 15.0
"""Degrees by which relative poses agree, and by which one is that of a look-alike."""
SHIFTED = 1.0
"""Baselines by which the place of a camera misses, from which on it is that of a look-alike."""


def twins(
    poses: Mapping[ViewId, Array], pairs: Pairs, rigs: Sequence[Sequence[str]]
) -> tuple[frozenset[ViewId], int]:
    """Find the views whose relative pose to another camera of their rig is not that of the other frames.

    Args:
        poses: cam_from_world [4, 4] of each registered view.
        pairs: Views that match.
        rigs: Names of cameras that are mounted to each other.

    Returns:
        The views, and how many frames agree. Of two views that cannot both be right it is the one that
        shares fewer matches with the frames that agree; no view where less than two thirds of the frames
        agree, as of cameras that are not rigidly mounted.
    """
    wrong: set[ViewId] = set()
    agreeing = 0
    for one, other in (pair for rig in rigs for pair in combinations(rig, 2)):
        relative = {
            view.frame: poses[there] @ np.linalg.inv(pose)
            for view, pose in poses.items()
            if view.camera == one and (there := ViewId(view.frame, other)) in poses
        }
        usual = _usual(relative)
        if len(usual) < max(FEWEST_FRAMES, 2 * len(relative) / 3):
            continue
        agreeing = max(agreeing, len(usual))
        middle = relative[
            min(usual, key=lambda one: sum(_apart(relative[one], relative[frame])[0] for frame in usual))
        ]
        baseline = float(np.linalg.norm(middle[:3, 3]))
        right = {ViewId(frame, camera) for frame in usual for camera in (one, other)}
        for frame in relative.keys() - usual:
            turn, shift = _apart(relative[frame], middle)
            if turn > FAR or shift > SHIFTED * baseline:
                views = ViewId(frame, one), ViewId(frame, other)
                wrong.add(min(views, key=lambda view: _support(view, right, pairs)))
    return frozenset(wrong), agreeing


def _usual(relative: Mapping[int, Array]) -> set[int]:
    """The largest set of frames whose relative poses are near to that of one of them."""
    sets = []
    for middle in relative.values():
        most = 0.5 * SHIFTED * float(np.linalg.norm(middle[:3, 3]))
        apart = {frame: _apart(pose, middle) for frame, pose in relative.items()}
        sets.append({frame for frame, (turn, shift) in apart.items() if turn <= NEAR and shift <= most})
    return max(sets, key=len, default=set())


def _apart(one: Array, other: Array) -> tuple[float, float]:
    """Degrees between the turns of two poses, and the distance between their shifts."""
    cosine = 0.5 * (np.trace(one[:3, :3].T @ other[:3, :3]) - 1.0)
    shift = float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))), shift


def _support(view: ViewId, right: set[ViewId], pairs: Pairs) -> int:
    """Matches of a view with those that stand right."""
    return sum(
        len(pair.one)
        for (one, other), pair in pairs.items()
        if (one == view and other in right) or (other == view and one in right)
    )
