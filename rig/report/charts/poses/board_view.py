"""Poses of a board, seen from the cameras that it calibrated: a turntable for each rig."""

from collections.abc import Iterable, Sequence

import numpy as np

from imaging.arrays import Array
from imaging.session.calibration import CalibrationRecord
from imaging.session.calibration_evidence import BoardPlace
from imaging.session.records import Board
from imaging.session.view_id import ViewId
from rig.report.charts.poses.rig_view import turntable
from rig.report.charts.topic import Figure
from rig.terminal.text import counted

MOST_RIGS = 4
"""Most separate drawings of cameras that never saw the board together."""


def board_figures(record: CalibrationRecord) -> Iterable[Figure]:
    """A drawing for each rig that saw the board, or camera that saw it alone, in its own axes."""
    if record.board is None:
        return
    for number, places in enumerate(_groups(record.board.places)[:MOST_RIGS]):
        names = sorted({name for place in places for name in place.cameras})
        mounted = {name: record.camera(name).cam_from_rig for name in names}
        # A camera that saw the board alone is the origin.
        cameras = {
            name: np.eye(4) if pose is None else pose.matrix()
            for name, pose in mounted.items()
            if pose is not None or len(names) == 1
        }
        boards = {
            place.frame: _around(record.board.board, cameras[place.cameras[0]], place)
            for place in places
            if place.cameras[0] in cameras
        }
        if boards:
            yield Figure(
                f"The board before {', '.join(names) if len(names) <= 4 else counted(len(names), 'camera')}",
                "Each rectangle is the board at one frame. It is most use held near and far, tilted "
                "to all sides, and in the corners of every image.",
                turntable(
                    {ViewId(0, name): pose for name, pose in cameras.items()},
                    {camera.name: camera.lens for camera in record.cameras if camera.lens is not None},
                    np.zeros((0, 3)),
                    metric=True,
                    boards=boards,
                    group=f"board{number}",
                ),
                wide=True,
            )


def _groups(places: Sequence[BoardPlace]) -> list[list[BoardPlace]]:
    """Places whose cameras saw the board together, if only by way of others."""
    groups: list[tuple[set[str], list[BoardPlace]]] = []
    for place in places:
        names, places = set(place.cameras), [place]
        for group in [group for group in groups if group[0] & names]:
            groups.remove(group)
            names |= group[0]
            places = [*group[1], *places]
        groups.append((names, places))
    return [places for _, places in groups]


def _around(board: Board, cam_from_rig: Array, place: BoardPlace) -> Array:
    """The board's corners in the axes of the rig, float64 [4, 3]."""
    wide, high = board.columns * board.square, board.rows * board.square
    corners = np.array([[0, 0, 0], [wide, 0, 0], [wide, high, 0], [0, high, 0]])
    motion = np.linalg.inv(cam_from_rig) @ place.cam_from_board.matrix()
    return np.asarray(corners @ motion[:3, :3].T + motion[:3, 3])
