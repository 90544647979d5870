"""The corners of a ChArUco board in a picture, to a fraction of a pixel."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np

from imaging.arrays import Array, Bytes, Integers, Mask
from imaging.errors import CalibrationError
from imaging.progress import Progress
from imaging.session.records import Board
from imaging.session.view_id import ViewId

_SMOOTH = 1.0
"""px, standard deviation of the Gaussian that pictures are smoothed with before corners are refined."""
_HALF = (2, 5)
"""Smallest and largest half width of the window around a corner, px."""
_ROUNDS, _SETTLED = 20, 1e-3
"""Steps towards a corner, and the length of one, px, after which no other follows."""
FEWEST = 6
"""Corners of a view that are worth having: a pose needs four."""
_TRIALS = 12
"""Number of pictures examined to identify the board."""
_NEAR_PX = 3.0
"""Largest distance of corners from a plane view that is sought among the few of two rows or columns."""
_OFF = 0.08
"""Largest distance of a corner from a plane view of the board, as a share of the square's side in the
picture: the lens bends straight lines, but a board of other rows and columns misses by whole squares.
"""


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of one view: ids int64 [K]; points float64 [K, 2], px, pixel centres at +0.5."""

    ids: Integers
    points: Array


@dataclass(frozen=True)
class Print:
    """Printing of the board: with the pattern before OpenCV 4.6, or black for white."""

    legacy: bool = False
    inverted: bool = False

    def __str__(self) -> str:
        words = [word for word, so in (("legacy", self.legacy), ("inverted", self.inverted)) if so]
        return " and ".join(words) or "as OpenCV prints it"


PRINTS = tuple(Print(legacy, inverted) for inverted, legacy in product((False, True), repeat=2))


def find_all(
    board: Board, views: Sequence[ViewId], read: Callable[[ViewId], Bytes], progress: Progress
) -> tuple[dict[ViewId, Corners], Print]:
    """The corners in every picture that shows enough of the board, and how the board is printed.

    Args:
        board: Description of the board.
        views: Views to search, at least one.
        read: Function that gives the picture of a view, uint8 [H, W]; called for one view at a time.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Corners by view, of the views with `FEWEST` or more; and the printing that shows most of them.

    Raises:
        CalibrationError: No picture shows the board that was described, or none enough of it.
    """
    some = views[:: -(-len(views) // _TRIALS)]
    counts = dict.fromkeys(PRINTS, 0)
    for done, view in enumerate(some):
        progress("recognising the board", done, len(some))
        picture = read(view)
        for one in PRINTS:
            counts[one] += len(find(board, picture, one).ids)
    best = max(PRINTS, key=lambda one: counts[one])  # the first of equals: nothing special
    if not counts[best]:
        raise CalibrationError(_nothing(board, [read(view) for view in some[:3]]))
    enough: dict[ViewId, Corners] = {}
    for done, view in enumerate(views):
        progress("finding the board", done, len(views))
        corners = find(board, read(view), best)
        if len(corners.ids) >= FEWEST:
            enough[view] = corners
    progress("finding the board", len(views), len(views))
    if not enough:
        raise CalibrationError(
            f"No picture shows {FEWEST} corners of the board or more: show it larger and whole."
        )
    return enough, best


def _nothing(board: Board, some: Sequence[Bytes]) -> str:
    name = f"{board.columns} x {board.rows} squares with markers of {board.dictionary}"
    turned = board.model_copy(update={"columns": board.rows, "rows": board.columns})
    if any(len(find(turned, picture, one).ids) >= FEWEST for picture in some for one in PRINTS):
        return (
            f"No picture shows a board of {name}, but of {turned.columns} x {turned.rows}: "
            "swap columns and rows in its description."
        )
    return (
        f"No picture shows a board of {name}: correct its description, or show it larger, flat and in focus."
    )


def find(board: Board, picture: Bytes, printed: Print) -> Corners:
    """The corners in one picture [H, W]; none where the board is not seen, or another one is."""
    if printed.inverted:
        picture = np.asarray(255 - picture, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    layout = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, dictionary)
    layout.setLegacyPattern(printed.legacy)
    detector = cv2.aruco.CharucoDetector(layout)
    points, ids, _, _ = detector.detectBoard(picture)
    if ids is None or points is None or len(np.ravel(ids)) < 4:
        return Corners(np.zeros(0, np.int64), np.zeros((0, 2)))
    ids = np.ravel(ids).astype(np.int64)
    points = np.asarray(points, np.float64).reshape(-1, 2)
    flat = board.corners()[ids, :2]
    side, keep = _plane_view(flat, points, board.square)
    ids, points = ids[keep], points[keep]
    if len(ids) < 4:
        return Corners(np.zeros(0, np.int64), np.zeros((0, 2)))
    margin = side * (1 - board.marker / board.square) / 2
    return Corners(ids, _refined(picture, points, margin) + 0.5)


def _plane_view(flat: Any, points: Any, square: float) -> tuple[float, Mask]:
    """Side of a square in the picture, px, and which corners lie where a plane board has them."""
    homography, _ = cv2.findHomography(flat, points, cv2.LMEDS)
    if homography is None:  # also where about half of the corners are in one line, as of two full rows
        homography, _ = cv2.findHomography(flat, points, cv2.RANSAC, _NEAR_PX)
    if homography is None or not np.isfinite(homography).all():
        return 0.0, np.zeros(len(points), bool)
    ahead, beside, below = (
        cv2.perspectiveTransform((flat + np.array(step)).reshape(-1, 1, 2), homography).reshape(-1, 2)
        for step in ((0.0, 0.0), (square, 0.0), (0.0, square))
    )
    sides = np.minimum(np.linalg.norm(beside - ahead, axis=1), np.linalg.norm(below - ahead, axis=1))
    return float(sides.min()), np.linalg.norm(ahead - points, axis=1) < _OFF * sides + 0.5


def _refined(picture: Bytes, points: Any, margin: float) -> Array:
    """Refine each corner to the saddle of the quadratic that fits the picture around it best.

    margin: px between a marker and the edge of its square: the window ends there, since the marker's own
    edges pull. Lucchese and Mitra, "Using saddle points for subpixel feature detection in camera calibration
    targets", 2002. `cv2.cornerSubPix` needs straight edges within its window, and runs away from the corner
    where the picture's blur fills it. A corner that does not settle stays where it is.
    """
    half = int(np.clip(margin - 1, *_HALF))
    picture = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), _SMOOTH)
    steps = np.arange(-half, half + 1.0)
    v, u = (axis.ravel() for axis in np.meshgrid(steps, steps, indexing="ij"))
    fit = np.linalg.pinv(np.stack([u * u, u * v, v * v, u, v, np.ones_like(u)], axis=1))[:5]
    refined = np.array(points, np.float64)
    for place, point in enumerate(refined.copy()):
        at = point
        for _ in range(_ROUNDS):
            around = cv2.getRectSubPix(picture, (2 * half + 1, 2 * half + 1), (float(at[0]), float(at[1])))
            uu, uv, vv, gu, gv = fit @ np.asarray(around, np.float64).ravel()
            bend = np.array([[2 * uu, uv], [uv, 2 * vv]])
            if np.linalg.det(bend) >= 0:  # a hill or a valley
                break
            step = -np.linalg.solve(bend, (gu, gv))
            at = at + step
            if np.linalg.norm(at - point) > half:
                break
            if np.abs(step).max() < _SETTLED:
                refined[place] = at
                break
    return refined
