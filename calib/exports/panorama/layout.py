"""Directions and solid angles of a map of latitude and longitude, in the layout of OpenEXR."""

from collections.abc import Mapping

import numpy as np

from imaging.arrays import Array

LAYOUT = (
    "latitude and longitude as OpenEXR has them, +y up: the middle of the picture is longitude 0, its left "
    "end 180 degrees, its uppermost row latitude 90; vectors are in world axes"
)


def directions(rows: int, first: int, last: int) -> Array:
    """Unit vectors [last - first, 2 * rows, 3] along the axes of a map of `rows` rows, of those rows.

    The axes: of longitude 90 degrees, of latitude 90 degrees, and of the middle of the map.
    """
    latitude = np.pi * (0.5 - (np.arange(first, last) + 0.5) / rows)[:, None]
    longitude = np.pi * (1 - (np.arange(2 * rows) + 0.5) / rows)[None]
    return np.stack(
        [
            np.cos(latitude) * np.sin(longitude),
            np.broadcast_to(np.sin(latitude), (last - first, 2 * rows)),
            np.cos(latitude) * np.cos(longitude),
        ],
        axis=-1,
    )


def solid_angles(rows: int) -> Array:
    """Steradians of a texel of each row, [rows, 1]."""
    edges = np.sin(np.pi * (0.5 - np.arange(rows + 1) / rows))
    return np.asarray((edges[:-1] - edges[1:])[:, None] * np.pi / rows)


def degrees(direction: Array) -> tuple[float, float]:
    """Longitude and latitude of a direction along the axes of the map."""
    x, y, z = direction / np.linalg.norm(direction)
    return float(np.degrees(np.arctan2(x, z))), float(np.degrees(np.arcsin(y)))


def header(axes: Array) -> Mapping[str, str]:
    """Attributes that say which way the map lies; axes: its axes in those of the world, as rows."""
    side, up, middle = (" ".join(f"{part:.9g}" for part in axis) for axis in axes)
    return {"rig:layout": LAYOUT, "rig:up": up, "rig:middle": middle, "rig:longitude90": side}
