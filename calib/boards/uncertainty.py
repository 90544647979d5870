"""Errors of a rig: the adjustment repeated on frames drawn anew (bootstrap over frames).

Frames are what varies independently; corners of one view share its blur, its light and the board's flatness.
All terms of the lens are free meanwhile, also those that the ladder did not take: that a term is too small to
be seen does not make what it trades places with (the principal point, the camera's turn) any surer.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from calib.adjustment.bundle_adjustment import Free
from calib.boards.corners import Corners
from calib.boards.ladder import richest
from calib.boards.rig import Solved, solve
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.optics import lens as optics
from imaging.optics.lens import Lens
from imaging.progress import Progress
from imaging.session.records import Board
from imaging.session.view_id import ViewId

DRAWS = 50
GRID = (9, 6)
"""Places across and down the image of the projection-uncertainty map."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard errors.

    lenses: by camera and term. rotation: degrees, of the camera in the rig, about its worst axis;
    translation: m, along its worst. map: px [rows, columns], how far a far point's projection may be off at
    places evenly spread over the image, when the camera's own turn is not counted; inf where the frames do
    not say that the lens reaches at all.
    halves: how far the odd and the even frames disagree about a lens, relative to what `map` lets expect:
    1 or less; above 1.5 no one lens of this kind fits all frames (mrcal's cross-validation).
    draws, failed: how many drawings gave a rig, and how many none; the errors are those of the former.
    """

    lenses: dict[str, dict[str, float]]
    rotation: dict[str, float]
    translation: dict[str, float]
    map: dict[str, Array]
    halves: dict[str, float]
    draws: int
    failed: int


def bootstrap(
    board: Board,
    corners: Mapping[ViewId, Corners],
    solved: Solved,
    taken: Free,
    progress: Progress,
) -> Uncertainty:
    """Draw the frames with replacement and solve, DRAWS times, always the same draws.

    Args:
        board: Description of the board.
        corners: Corners by view, without outliers.
        solved: Rig that fits all of them.
        taken: Lens model with which `solved` was found; all terms of its kind of lens are free in the draws.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Standard errors; empty where all frames together give no rig.
    """
    # The richest lens that was tried: a simpler one would be sure of what it cannot express.
    free = richest(taken)
    try:
        middle = solve(board, corners, solved, free)
    except CalibrationError:
        return Uncertainty({}, {}, {}, {}, {}, draws=0, failed=DRAWS)
    # Frames are drawn whole: corners of one picture err together, by the bend of the board and by blur.
    rng = np.random.default_rng(0)
    frames = sorted({view.frame for view in corners})
    lenses: dict[str, list[Lens]] = {name: [] for name in solved.cam_from_rig}
    turns: dict[str, list[Array]] = {name: [] for name in solved.cam_from_rig}
    shifts: dict[str, list[Array]] = {name: [] for name in solved.cam_from_rig}
    failed = 0
    for draw in range(DRAWS):
        progress("measuring how sure it is", draw, DRAWS)
        chosen = rng.choice(frames, len(frames))
        again = {
            ViewId(place, name): corners[ViewId(frame, name)]
            for place, frame in enumerate(chosen.tolist())
            for name in solved.cam_from_rig
            if ViewId(frame, name) in corners
        }
        boards = {place: middle.rig_from_board[frame] for place, frame in enumerate(chosen.tolist())}
        if {view.camera for view in again} != set(solved.cam_from_rig):
            continue  # a camera that none of the drawn frames shows has nothing to vary by
        # From the solution of all frames, each draw needs a few steps only.
        start = Solved(middle.lenses, middle.cam_from_rig, boards, np.zeros(0), [])
        try:
            drawn = solve(board, again, start, free)
        except CalibrationError:
            failed += 1
            continue
        for name, pose in drawn.cam_from_rig.items():
            apart = pose @ np.linalg.inv(middle.cam_from_rig[name])
            lenses[name].append(drawn.lenses[name])
            turns[name].append(np.ravel(cv2.Rodrigues(apart[:3, :3])[0]))
            shifts[name].append(apart[:3, 3])
    progress("measuring how sure it is", DRAWS, DRAWS)
    maps = {name: projection_map(middle.lenses[name], draws) for name, draws in lenses.items()}
    return Uncertainty(
        lenses={
            name: {
                term: _spread([getattr(lens, term) for lens in draws]) for term in middle.lenses[name].names
            }
            for name, draws in lenses.items()
        },
        rotation={name: float(np.degrees(_widest(draws))) for name, draws in turns.items()},
        translation={name: _widest(draws) for name, draws in shifts.items()},
        map=maps,
        halves=_halves(board, corners, middle, free, maps),
        draws=len(next(iter(lenses.values()))),
        failed=failed,
    )


def _halves(
    board: Board, detected: Mapping[ViewId, Corners], middle: Solved, free: Free, maps: Mapping[str, Array]
) -> dict[str, float]:
    """The disagreement of two halves is twice what is expected of the whole: each has half of the frames."""
    frames = sorted({view.frame for view in detected})
    sides = []
    for start in (0, 1):
        half = {view: corners for view, corners in detected.items() if view.frame in set(frames[start::2])}
        if {view.camera for view in half} != set(middle.cam_from_rig):
            return {}
        try:
            sides.append(solve(board, half, middle, free).lenses)
        except CalibrationError:
            return {}
    ratios = {}
    for name, whole in maps.items():
        apart = projection_map(sides[0][name], [sides[1][name]])
        known = np.isfinite(whole) & np.isfinite(apart)
        if known.any() and whole[known].mean() > 0:
            ratios[name] = float(apart[known].mean() / (2.0 * whole[known].mean()))
    return ratios


def _spread(values: list[float]) -> float:
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")


def _widest(vectors: list[Array]) -> float:
    """Standard deviation along the direction in which it is the largest."""
    if len(vectors) < 2:
        return float("nan")
    return float(np.sqrt(np.linalg.eigvalsh(np.cov(np.stack(vectors).T))[-1].clip(0.0)))


def projection_map(lens: Lens, drawn: list[Lens]) -> Array:
    """Standard deviation, px [rows, columns], of where drawn lenses see what `lens` sees at a grid of places.

    A lens whose middle is elsewhere is a camera that looks elsewhere: the turn that brings the drawn lens's
    rays nearest to the lens's own is taken out, as mrcal does (https://mrcal.secretsauce.net, "Projection
    uncertainty"). inf where `lens`, or any of those drawn, folds the world over before it.
    """
    columns, rows = GRID
    across = (np.arange(columns) + 0.5) * lens.width / columns
    down = (np.arange(rows) + 0.5) * lens.height / rows
    places = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = optics.rays(lens, places)
    squares = np.where(optics.covers(lens, places), 0.0, np.inf)
    for other in drawn:
        shared = optics.covers(other, places)
        u, _, vt = np.linalg.svd(optics.rays(other, places[shared]).T @ rays[shared])
        turned = rays @ (u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt).T
        widest = optics.fold(other.terms[4:], fisheye=other.fisheye)
        ends = shared & (np.linalg.norm(turned[:, :2], axis=1) < widest * turned[:, 2])
        squares[~ends] = np.inf
        squares[ends] += ((optics.project(other, turned[ends]) - places[ends]) ** 2).sum(1)
    return np.sqrt(squares / max(len(drawn), 1)).reshape(rows, columns)
