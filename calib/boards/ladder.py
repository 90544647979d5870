"""Choice of the lenses' terms on frames that did not take part in fitting them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calib.adjustment.bundle_adjustment import Free
from calib.adjustment.fisheye import may_be_fisheye
from calib.adjustment.lens_ladder import mean_gain
from calib.boards.corners import Corners
from calib.boards.rig import Solved, solve
from imaging.arrays import Array
from imaging.progress import Progress
from imaging.session.records import Board, Rung
from imaging.session.view_id import ViewId

FOLDS = 4
FEWEST_FRAMES = 8
_BASE = Free("PINHOLE", principal_point=True)
_STEPS = (
    ("lens_radial_1", Free("SIMPLE_RADIAL", principal_point=True), "one radial term"),
    ("lens_radial_2", Free("RADIAL", principal_point=True), "a second radial term"),
    ("lens_tangential", Free("OPENCV", principal_point=True), "tangential terms and two focal lengths"),
)
RICHEST = _STEPS[-1][1]
FISHEYE = Free("OPENCV_FISHEYE", principal_point=True)


def richest(free: Free) -> Free:
    """All terms of the kind of lens that was taken."""
    return FISHEYE if free.model == FISHEYE.model else RICHEST


def climb(
    board: Board, corners: Mapping[ViewId, Corners], solved: Solved, progress: Progress
) -> tuple[Free, tuple[Rung, ...]]:
    """The lens model to take for all cameras, and why.

    A fold's frames are held out of the fit; then only the poses of the board are found in them, and the
    corners have to fit. The gain is in px^2 of mean squared miss, its error over frames. Where a camera sees
    far from its axis, a fisheye is tried last against what was taken.

    Args:
        board: Description of the board.
        corners: Corners by view, without outliers.
        solved: Rig and poses of the board from these corners, from which every fit begins.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The lens model that was taken, and a rung for each trial.

    Raises:
        CalibrationError: The corners of a fold or of the others fit no lens.
    """
    frames = sorted({view.frame for view in corners})
    if len(frames) < FEWEST_FRAMES:
        reason = f"{len(frames)} frames of the board cannot judge distortion beyond one radial term"
        return _STEPS[0][1], (Rung(name="lens_terms", taken=False, reason=reason),)
    below, count = _held_out(board, corners, solved, _BASE, frames)
    taken = _BASE
    rungs = []
    steps = list(_STEPS)
    if any(may_be_fisheye(lens) for lens in solved.lenses.values()):
        steps.append(("lens_fisheye", FISHEYE, "a fisheye: terms of the angle from the axis instead"))
    for done, (name, free, what) in enumerate(steps):
        progress("judging the lens", done, len(steps))
        above, _ = _held_out(board, corners, solved, free, frames)
        gain, error = mean_gain(below - above, count)
        rung = Rung.judged(name, gain, error, "px^2 of held-out corners, over frames of the board", what)
        rungs.append(rung)
        if rung.taken:
            taken, below = free, above
    progress("judging the lens", len(steps), len(steps))
    return taken, tuple(rungs)


def _held_out(
    board: Board, corners: Mapping[ViewId, Corners], solved: Solved, free: Free, frames: list[int]
) -> tuple[Array, Array]:
    """Sum of squared misses of each frame when it is held out, px^2 [frames], and its number of corners."""
    losses, counts = np.zeros(len(frames)), np.zeros(len(frames))
    for fold in range(FOLDS):
        out = set(frames[fold::FOLDS])
        fitted = solve(
            board, {view: corners[view] for view in corners if view.frame not in out}, solved, free
        )
        # The poses of the held-out frames are those of the start, in whose rig they were found.
        begin = replace(fitted, rig_from_board=dict(solved.rig_from_board))
        tested = solve(
            board,
            {view: corners[view] for view in corners if view.frame in out},
            begin,
            free,
            boards_only=True,
        )
        for (view, _), miss in zip(tested.places, tested.misses, strict=True):
            losses[frames.index(view.frame)] += float(miss) ** 2
            counts[frames.index(view.frame)] += 1
    return losses, counts
