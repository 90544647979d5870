"""Positions and gimbal attitudes in photographs' files, and their errors."""

from collections.abc import Mapping, Sequence

import numpy as np

from calib.adjustment.place_priors import StatedPlace
from calib.data.views import View
from calib.survey.gps import FEWEST
from calib.survey.points import east_north_up
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.files.photo import read_metadata
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.session import Session
from imaging.session.view_id import ViewId

FLAT, UP = 2.5, 6.0
"""m: standard deviations of a receiver's position and height where the file states none."""
BAROMETER = 0.4
"""m, of a drone's heights against each other."""
TILT, HEADING = np.radians(0.5), np.radians(15.0)
"""Standard deviations of a gimbal: it hangs level to half a degree, and its compass is as good as compasses
near motors are.
"""


def stated_places(session: Session, views: Sequence[View]) -> dict[ViewId, StatedPlace]:
    """Read where views were taken, east, north and up of their median; {}: fewer than FEWEST say it."""
    metadata_of: dict[ViewId, FrameMetadata] = {}
    for view in views:
        try:
            metadata = read_metadata(session.file(view.shots[0]))
        except InputError:
            continue
        if metadata.position is not None and metadata.position.altitude is not None:
            metadata_of[view.id] = metadata
    return places_of(metadata_of) if len(metadata_of) >= FEWEST else {}


def places_of(metadata_of: Mapping[ViewId, FrameMetadata]) -> dict[ViewId, StatedPlace]:
    """The same of metadata that all have a position with its height."""
    positions = [one.position for one in metadata_of.values() if one.position is not None]
    geodetic = np.array([(one.latitude, one.longitude, one.altitude) for one in positions], np.float64)
    heights = np.array([np.nan if one.height is None else one.height for one in metadata_of.values()])
    # A receiver with corrections (RTK) errs by less than a barometer, which drifts during a flight.
    precise = np.array([0.0 < (one.altitude_error or 0.0) < BAROMETER for one in positions])
    pressed = ~precise & bool(np.isfinite(heights).all())
    if pressed.any():
        above = geodetic[:, 2] - heights
        geodetic[pressed, 2] = heights[pressed] + np.median(above[precise] if precise.any() else above)
    latitude, longitude, height = np.median(geodetic, axis=0).tolist()
    centres = east_north_up(geodetic, (latitude, longitude, height))
    places = {}
    rows = zip(metadata_of.items(), positions, centres, pressed.tolist(), strict=True)
    for (view, metadata), position, centre, by_pressure in rows:
        up = position.altitude_error or max(UP, 2 * (position.error or 0.0))
        up = BAROMETER if by_pressure else up
        flat = position.error or FLAT
        turn = None if metadata.gimbal is None or metadata.orientation != 1 else gimbal_turn(*metadata.gimbal)
        places[view] = StatedPlace(centre, np.array([flat, flat, up]), turn, float(TILT), float(HEADING))
    return places


def gimbal_turn(yaw: float, pitch: float, roll: float) -> Array:
    """Turn east, north and up into the axes of a camera: right, down and ahead.

    Args:
        yaw: degrees, clockwise from north.
        pitch: degrees, up from level.
        roll: degrees, clockwise as the camera looks.

    Returns:
        The rotation [3, 3].
    """
    yaw, pitch, roll = np.radians([yaw, pitch, roll]).tolist()
    ahead = np.array([np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)])
    level = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    below = np.cross(ahead, level)
    right = np.cos(roll) * level + np.sin(roll) * below
    return np.stack([right, np.cross(ahead, right), ahead])
