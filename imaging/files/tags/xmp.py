"""XMP packets: what a drone says of its camera's attitude, its height, its position and the error of that.

The names are DJI's (`drone-dji`), as attributes or as elements; other makers write none that are alike. The
packet lies in a segment of a JPEG, tag 700 of a TIFF or DNG, an item of a HEIF, or a chunk of a PNG or WebP.
"""

import math
import re
from dataclasses import dataclass, replace

from imaging.sensor.mosaic import FrameMetadata, GpsPosition

MARK = b"http://ns.adobe.com/xap/1.0/\0"
"""Prefix of a JPEG segment that holds a packet."""
_FIXED = 50.0
"""RtkFlag of a position that is known to centimetres."""


@dataclass(frozen=True)
class DroneNote:
    """gimbal: yaw, clockwise from north, pitch, up, and roll of the camera, degrees. height: m above the
    take-off point, by its barometer. position: of its receiver, without errors. error, altitude_error:
    standard errors of a position that a base station corrected, m. None: not stated.
    """

    gimbal: tuple[float, float, float] | None = None
    height: float | None = None
    position: GpsPosition | None = None
    error: float | None = None
    altitude_error: float | None = None


def drone_note(packet: bytes) -> DroneNote:
    """Return the content of a drone's packet; an empty note for any other packet, or a damaged one."""
    if b"drone-dji" not in packet:
        return DroneNote()
    angles = [_number(packet, f"Gimbal{axis}Degree") for axis in ("Yaw", "Pitch", "Roll")]
    yaw, pitch, roll = angles
    plausible = yaw is not None and pitch is not None and abs(yaw) <= 360 and abs(pitch) <= 180
    gimbal = (yaw, pitch, roll or 0.0) if plausible and yaw is not None and pitch is not None else None
    errors = [_number(packet, f"RtkStd{axis}") for axis in ("Lon", "Lat", "Hgt")]
    east, north, up = errors if _number(packet, "RtkFlag") == _FIXED else (None, None, None)
    flat = max(east, north) if east is not None and north is not None else None
    return DroneNote(
        gimbal,
        _number(packet, "RelativeAltitude"),
        _position(packet),
        flat if flat else None,
        up if up and up > 0 else None,
    )


def noted(metadata: FrameMetadata, packet: bytes) -> FrameMetadata:
    """The metadata of a file with what its XMP packet says of a drone; EXIF's position counts before that."""
    note = drone_note(packet)
    position = metadata.position or note.position
    if position is not None:
        error = note.error or position.error
        position = replace(position, error=error, altitude_error=note.altitude_error)
    return replace(metadata, gimbal=note.gimbal, height=note.height, position=position)


def _position(packet: bytes) -> GpsPosition | None:
    """Return where the receiver was; older firmware spells its longitude GpsLongtitude."""
    latitude = _number(packet, "GpsLatitude")
    longitude = _number(packet, "GpsLongitude") or _number(packet, "GpsLongtitude")
    if not latitude or not longitude or abs(latitude) > 90 or abs(longitude) > 180:  # 0, 0 is no fix
        return None
    return GpsPosition(latitude, longitude, _number(packet, "AbsoluteAltitude"))


def _number(packet: bytes, name: str) -> float | None:
    match = re.search(
        rb"drone-dji:" + name.encode() + rb"\s*(?:=\s*[\"']|>)\s*([-+]?\d+(?:\.\d*)?)\s*[\"'<]", packet
    )
    value = math.nan if match is None else float(match.group(1))
    return value if math.isfinite(value) and abs(value) < 1e5 else None
