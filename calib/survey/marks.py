"""Positions of surveyed points in views: clicked by a person, or detected as ArUco and AprilTag markers."""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path, PurePath

import cv2
import numpy as np

from calib.data.views import View
from calib.survey.points import number_of, read_table
from imaging.arrays import Bytes
from imaging.errors import InputError
from imaging.progress import Progress
from imaging.session.coordinates import PointMark
from imaging.session.session import Session
from imaging.session.view_id import ViewId

Marks = dict[str, dict[ViewId, PointMark]]
"""Marks by the names of the point and the view."""

_COLUMNS = ("name", "image", "u", "v")
_NUMBERED = re.compile(r"(?:(?:aruco|april)?(?:target|marker|tag|id)?[ _-]*)0*(\d+)", re.IGNORECASE)
_CORNER = 5
"""Largest half width of the window around a corner of a marker, px."""


def read_marks(path: Path, session: Session, names: Collection[str]) -> Marks:
    """Return what was clicked: a table of `name`, `image`, `u` and `v`.

    names: of the survey. An image is a view as `0003/cam0`, or the photograph by its name; u and v are px
    of its file from its upper left corner. InputError of one sentence that names file, line and fault.
    """
    _, separator, rows = read_table(path)
    heading = [word.lower() for word in rows[0][1]] if rows else []
    if not set(_COLUMNS) <= set(heading):
        raise InputError(f"{path} has no heading that names its columns: begin with {','.join(_COLUMNS)}.")
    photographs = _photographs(session)
    sizes = {shot.view: (shot.width, shot.height) for shot in session.shots("scene")}
    marks: Marks = {}
    for line, fields in rows[1:]:
        where = f"{path}, line {line}"
        try:
            name, image, u, v = (fields[heading.index(column)] for column in _COLUMNS)
            at = number_of(u, separator), number_of(v, separator)
        except (IndexError, ValueError) as error:
            raise InputError(
                f"{where} is not {','.join(heading)}: write two names and two numbers there, or remove it."
            ) from error
        if name not in names:
            raise InputError(
                f"{where}: the survey has no point {name!r}: correct the name, or remove the line."
            )
        views = photographs.get(image) or photographs.get(PurePath(image).name) or set()
        if len(views) != 1:
            what = "several images are" if views else "no image is"
            raise InputError(
                f"{where}: {what} called {image!r} in {session.folder}: name its view, as 0003/cam0."
            )
        (view,) = views
        width, height = sizes[view]
        if not (0 <= at[0] <= width and 0 <= at[1] <= height):
            raise InputError(
                f"{where}: ({at[0]:g}, {at[1]:g}) is outside of {image}, which has {width} x {height} px: "
                "u and v are px from its upper left corner."
            )
        if view in marks.setdefault(name, {}):
            raise InputError(f"{where}: {name} has a mark in {image} already: remove one of them.")
        marks[name][view] = PointMark(view=view, at=at)
    if not marks:
        raise InputError(f"{path} has no marks: add a line for each image that shows a surveyed point.")
    return marks


def _photographs(session: Session) -> dict[str, set[ViewId]]:
    """Views by every name that their shots are known under."""
    known: dict[str, set[ViewId]] = {}
    for shot in session.shots("scene"):
        names = {str(shot.view), shot.file}
        for path in (shot.source, shot.developed):
            if path is not None:
                names |= {path, PurePath(path).name, PurePath(path).stem}
        for name in names:
            known.setdefault(name, set()).add(shot.view)
    return known


def dictionary_of(name: str) -> str:
    """OpenCV's name of a dictionary of markers, in any case; InputError for an unknown one."""
    for attribute in dir(cv2.aruco):
        if attribute.startswith("DICT_") and attribute.upper() in (name.upper(), f"DICT_{name.upper()}"):
            return attribute
    raise InputError(
        f"OpenCV has no markers {name!r}: name a dictionary, as DICT_APRILTAG_36H11 or DICT_4X4_50."
    )


def numbers_of(names: Iterable[str]) -> dict[int, str]:
    """Points that are called by the number of a marker: `7`, `07`, `marker 7`, `target_7`."""
    return {int(match[1]): name for name in names if (match := _NUMBERED.fullmatch(name))}


def find_markers(
    dictionary: str,
    names: Collection[str],
    views: Sequence[View],
    read: Callable[[View], Bytes],
    progress: Progress,
) -> Marks:
    """The middles of all markers that are points of the survey, in every view.

    Args:
        dictionary: OpenCV's name of the dictionary of the markers.
        names: Names of the surveyed points, which give the numbers of their markers.
        views: Views to search.
        read: Function that gives the picture of a view, uint8 [H, W]; called for one view at a time.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Marks by point and view, px of the picture.
    """
    numbers = numbers_of(names)
    marks: Marks = {}
    for done, view in enumerate(views):
        progress("finding markers", done, len(views))
        for number, at in detect(dictionary, read(view)).items():
            if number in numbers:
                mark = PointMark(view=view.id, at=at, detected=True)
                marks.setdefault(numbers[number], {})[view.id] = mark
    progress("finding markers", len(views), len(views))
    return marks


def detect(dictionary: str, picture: Bytes) -> dict[int, tuple[float, float]]:
    """The middle of each marker by number, px, pixel centres at +0.5; one that is there twice is left out.

    The middle is where the diagonals meet, which perspective keeps.
    """
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    options.cornerRefinementWinSize = _CORNER
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary)), options
    )
    corners, ids, _ = detector.detectMarkers(picture)
    places: dict[int, tuple[float, float]] = {}
    if ids is None:
        return places
    numbers = [int(number) for number in np.ravel(ids)]
    for number, quad in zip(numbers, corners, strict=True):
        if numbers.count(number) == 1:
            a, b, c, d = np.column_stack([np.asarray(quad, np.float64).reshape(4, 2), np.ones(4)])
            x, y, w = np.cross(np.cross(a, c), np.cross(b, d))
            places[number] = float(x / w) + 0.5, float(y / w) + 0.5
    return places


def joined(clicked: Mapping[str, Mapping[ViewId, PointMark]], detected: Marks) -> Marks:
    """All marks; where both are there, the clicked one."""
    return {
        name: {**detected.get(name, {}), **clicked.get(name, {})}
        for name in dict.fromkeys([*clicked, *detected])
    }
