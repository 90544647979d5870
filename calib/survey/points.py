"""Surveyed points from a table: who, where, and how sure.

A heading names the columns, in any order: `name`, and `x`, `y`, `z` or `easting`, `northing`, `height` in
metres, or `latitude`, `longitude`, `altitude` in degrees of WGS84 and metres above its ellipsoid; `sigma`, m,
may be added. A comment such as `# EPSG:25832` says what projected coordinates are.
"""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.survey.similarity import FEWEST
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.files.colmap import pycolmap

_SYSTEMS = (
    (("x",), ("y",), ("z",)),
    (("easting", "east", "e"), ("northing", "north", "n"), ("height", "elevation", "altitude", "z")),
    (("latitude", "lat"), ("longitude", "lon", "long", "lng"), ("altitude", "alt", "height", "elevation")),
)
_GEODETIC = 2
ENU = "WGS84 east-north-up"
WHOLE, LARGE = 100.0, 1000.0
"""m: coordinates beyond LARGE are given less of a multiple of WHOLE, so that single precision holds them."""


@dataclass(frozen=True)
class SurveyPosition:
    """Position of a point, m, and the standard error of each coordinate, if it is stated."""

    position: tuple[float, float, float]
    sigma: float | None = None


@dataclass(frozen=True)
class Survey:
    """Points by name, in one system; origin: of an east-north-up one, as `CoordinateSystem` has it."""

    points: Mapping[str, SurveyPosition]
    system: str = "local"
    origin: tuple[float, float, float] | None = None

    @property
    def offset(self) -> tuple[float, float, float]:
        """Offset subtracted from the coordinates for single precision, m; zeros where they are small."""
        places = np.array([point.position for point in self.points.values()])
        if np.abs(places).max() < LARGE:
            return 0.0, 0.0, 0.0
        x, y, z = (WHOLE * np.round(places.mean(0) / WHOLE)).tolist()
        return x, y, z


def read_survey(path: Path) -> Survey:
    """The points of a table; InputError of one sentence that names file, line and fault."""
    text, separator, rows = read_table(path)
    heading, rows = (rows[0][1], rows[1:]) if rows else ([], [])
    system, columns = _columns(path, heading)
    named: dict[str, SurveyPosition] = {}
    for line, fields in rows:
        where = f"{path}, line {line}"
        try:
            name = fields[columns[0]]
            numbers = [number_of(fields[place], separator) for place in columns[1:4]]
            stated = fields[columns[4]] if columns[4] is not None and columns[4] < len(fields) else ""
            sigma = number_of(stated, separator) if stated else None
        except (IndexError, ValueError) as error:
            raise InputError(
                f"{where} is not {', '.join(heading)}: write a name and numbers there, or remove the line."
            ) from error
        if not name or name in named:
            raise InputError(
                f"{where}: the name {name!r} is {'there twice' if name else 'missing'}: name it."
            )
        if sigma is not None and sigma <= 0:
            raise InputError(
                f"{where}: a sigma of {sigma:g} is not a standard error: leave it empty, or give metres."
            )
        if system == _GEODETIC and not (abs(numbers[0]) <= 90 and abs(numbers[1]) <= 360):
            raise InputError(
                f"{where}: no place has the latitude {numbers[0]:g} and the longitude {numbers[1]:g}: they "
                "are in degrees, the latitude at most 90; are the columns exchanged?"
            )
        named[name] = SurveyPosition((numbers[0], numbers[1], numbers[2]), sigma)
    if len(named) < FEWEST:
        raise InputError(
            f"{path} has {len(named)} points, and a scene needs {FEWEST} to be placed, better 6: add more."
        )
    code = re.search(r"EPSG:\s*(\d+)", text, re.IGNORECASE)
    if system == _GEODETIC:
        return _to_local(named)
    return Survey(named, f"EPSG:{code[1]}" if code else "local")


def read_table(path: Path) -> tuple[str, str, list[tuple[int, list[str]]]]:
    """Read a table: its text, its separator, and its lines that are no comments, with numbers; InputError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: save the table as CSV.") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: correct the path or its permissions.") from error
    if "\0" in text:
        raise InputError(f"{path} is not a text file: save the table as CSV.")
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    separator = next((mark for mark in ";\t" if lines and mark in lines[0][1]), ",")
    return text, separator, list(_split(path, lines, separator))


def _split(path: Path, lines: Sequence[tuple[int, str]], separator: str) -> Iterator[tuple[int, list[str]]]:
    for number, line in lines:
        try:
            fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
        except csv.Error as error:
            raise InputError(
                f"{path}, line {number} is not a valid table line: correct its quotes."
            ) from error
        yield number, [field.strip() for field in fields]


def number_of(text: str, separator: str) -> float:
    """A finite number of a table with this separator; ValueError."""
    # Numbers have decimal commas only where something else separates them.
    value = float(text if separator == "," else text.replace(",", "."))
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _columns(path: Path, heading: Sequence[str]) -> tuple[int, tuple[int, int, int, int, int | None]]:
    """Return which system the columns are of, and the places of name, three coordinates and sigma."""
    names = [word.lower() for word in heading]

    def place(words: Sequence[str]) -> int | None:
        return next((names.index(word) for word in words if word in names), None)

    name = place(("name", "label", "point", "id"))
    for system in (_GEODETIC, 1, 0):
        one, two, three = (place(words) for words in _SYSTEMS[system])
        if name is not None and one is not None and two is not None and three is not None:
            return system, (name, one, two, three, place(("sigma", "accuracy", "error")))
    raise InputError(
        f"{path} has no heading that names its columns: begin with name,x,y,z in metres, "
        "name,easting,northing,height or name,latitude,longitude,altitude; sigma may follow."
    )


def _to_local(named: Mapping[str, SurveyPosition]) -> Survey:
    """Geodetic points as east, north and up of their middle, m."""
    places = np.array([point.position for point in named.values()])
    latitude, longitude, height = places.mean(0).tolist()
    origin = round(latitude, 5), round(longitude, 5), round(height)
    points = {
        name: SurveyPosition((x, y, z), point.sigma)
        for (name, point), (x, y, z) in zip(
            named.items(), east_north_up(places, origin).tolist(), strict=True
        )
    }
    return Survey(points, ENU, (origin[0], origin[1], float(origin[2])))


def east_north_up(places: Array, origin: Sequence[float]) -> Array:
    """Latitudes, longitudes, degrees, and ellipsoidal heights, m, [K, 3] of WGS84 as m from an origin."""
    transform = pycolmap.GPSTransform(pycolmap.GPSTransformEllipsoid.WGS84)
    return np.asarray(transform.ellipsoid_to_enu(places, *origin), np.float64)
