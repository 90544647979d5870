"""Cameras as a table (CSV), a line a frame, as any program can write it.

The first line names the columns, in any order; lines that begin with # are passed over, but for `# up: z` (or
`y`) and `# metersPerUnit: 0.01`, which say what the coordinates of the program are, where those are of a file
of `rig export`. Poses are of the camera in the world, its axes x right, y up, z back, as Blender, Nuke, Maya
and USD have them:

* `frame`: whole numbers that rise; without it frames count from 1001.
* `m00` to `m23`, or to `m33`: the matrix from camera to world, row by row; or `x, y, z` and the quaternion
  `qw, qx, qy, qz`.
* the focal length: `fx` and, if it differs, `fy` in pixels; or `focal_mm` and `sensor_mm`, the width of the
  film back; or `fov_deg`, from left to right. Without any it is that of the first view.
* `width` and `height` of the picture, px, and `cx`, `cy`, its principal point from the upper left corner.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from imaging.arrays import Array
from imaging.errors import InputError
from recon.rendering.cameras.camera_paths import CameraPath
from recon.rendering.cameras.given_camera import camera_of
from recon.rendering.cameras.placement import Axes, GivenPath
from recon.splat import SplatCamera

_MATRIX = tuple(f"m{row}{column}" for row in range(3) for column in range(4))
_PLACE, _TURN = ("x", "y", "z"), ("qw", "qx", "qy", "qz")
_LENS = ("fx", "fy", "cx", "cy", "focal_mm", "sensor_mm", "fov_deg", "width", "height")
_KNOWN = {"frame", *_MATRIX, "m30", "m31", "m32", "m33", *_PLACE, *_TURN, *_LENS}


def read_table(path: Path, usual: SplatCamera) -> GivenPath:
    """The cameras of a table; `usual` stands in for the lens that it does not name. InputError."""
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as text: save it as CSV in UTF-8.") from error
    rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and line[0] != "#"]
    if not rows:
        raise InputError(f"{path} is empty: write a line that names the columns, and one a frame.")
    columns = [name.strip().lower() for name in next(csv.reader([rows[0][1]]))]
    has = set(columns)
    if unknown := sorted(has - _KNOWN):
        raise InputError(f"{path} has a column {unknown[0]!r}, which rig does not know: take it out.")
    if not (set(_MATRIX) <= has or {*_PLACE, *_TURN} <= has):
        raise InputError(f"{path} has no poses: name columns m00 to m23, or x, y, z, qw, qx, qy, qz.")
    cameras: list[SplatCamera] = []
    numbers: list[int] = []
    for number, line in rows[1:]:
        where = f"line {number} of {path}"
        cells = next(csv.reader([line]))
        if len(cells) != len(columns):
            raise InputError(f"{where} has {len(cells)} cells and the first line {len(columns)}: correct it.")
        row = {name: _number(cell, name, where) for name, cell in zip(columns, cells, strict=True)}
        if "frame" in row:
            if row["frame"] != int(row["frame"]) or (numbers and row["frame"] <= numbers[-1]):
                raise InputError(
                    f"{where} has a frame that is not an integer above the last one: correct it."
                )
            numbers.append(int(row["frame"]))
        cameras.append(camera_of(_pose(row, where), _lens(row, usual, where), where, opengl=True))
    return GivenPath(CameraPath(path.stem, tuple(cameras), tuple(numbers)), _axes(lines, path))


def _axes(lines: Sequence[str], path: Path) -> Axes | None:
    """Return the coordinate axes in the comments, or None."""
    up: str | None = None
    metres: float | None = None
    for number, line in enumerate(lines, 1):
        match = re.fullmatch(r"#\s*(up|metersPerUnit)\s*:\s*(.*?)[\s,]*", line, re.IGNORECASE)
        if match is None:
            continue
        where, value = f"line {number} of {path}", match[2].lower()
        if match[1].lower() == "up":
            if value not in ("y", "z"):
                raise InputError(f"{where} says that {value!r:.40} is up: write y or z.")
            up = value
        else:
            metres = _number(value, "metersPerUnit", where)
            if not metres > 0:
                raise InputError(f"{where} has a unit of {value:.40} m: write a number above 0.")
    if up is None and metres is None:
        return None
    return Axes(None if up is None else up == "z", 1.0 if metres is None else metres)


def _number(cell: str, name: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(
            f"{where} has {cell.strip()!r:.40} for {name}, which is not a finite number: correct it."
        )
    return value


def _pose(row: Mapping[str, float], where: str) -> Array:
    if _MATRIX[0] in row:
        return np.array([row[name] for name in _MATRIX]).reshape(3, 4)
    quaternion = np.array([row[name] for name in _TURN])
    if abs(np.linalg.norm(quaternion) - 1) > 1e-2:
        raise InputError(f"{where} has a quaternion that is not of length 1: correct it.")
    turn = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return np.column_stack([turn, [row[name] for name in _PLACE]])


def _lens(row: Mapping[str, float], usual: SplatCamera, where: str) -> dict[str, Any]:
    width, height = row.get("width", usual.width), row.get("height", usual.height)
    if "focal_mm" in row and not row.get("sensor_mm", 0) > 0:
        raise InputError(f"{where} has focal_mm without a sensor_mm, the width of the film back: add it.")
    if "focal_mm" in row:
        focal = row["focal_mm"] / row["sensor_mm"] * width
    elif "fov_deg" in row:
        if not 0 < row["fov_deg"] < 170:
            raise InputError(f"{where} has a fov_deg that is not within 0 to 170 degrees: correct it.")
        focal = width / 2 / math.tan(math.radians(row["fov_deg"]) / 2)
    else:
        focal = usual.fx * width / usual.width
    fx = row.get("fx", row.get("fy", focal))
    return {
        "width": int(width),
        "height": int(height),
        "fx": fx,
        "fy": row.get("fy", fx),
        "cx": row.get("cx", width / 2),
        "cy": row.get("cy", height / 2),
    }
