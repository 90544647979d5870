"""GPS directory of EXIF (Exif 3.0, 4.6.6), read and written.

A height counts from the sea, or since Exif 3.0 from the ellipsoid (GPSAltitudeRef 2 and 3: from the sea).
Files rarely state the version they follow, so both are read as one height: within a scene they differ
by a constant.
"""

from fractions import Fraction

from imaging.files.tiff.directory import ASCII, BYTE, RATIONAL, Directory, Entry, numbers, rational, text
from imaging.sensor.mosaic import GpsPosition

GPS_IFD = 34853
_LATITUDE_REF, _LATITUDE, _LONGITUDE_REF, _LONGITUDE, _ALTITUDE_REF, _ALTITUDE = 1, 2, 3, 4, 5, 6
_STATUS, _DATUM, _ERROR = 9, 18, 31
_BELOW = (1, 3)
"""GPSAltitudeRef of heights below what they count from; 0 and 2 are above."""
_WGS84 = ("WGS84", "WGS1984", "WORLDGEODETIC", "ITRF", "ETRS", "JGD", "GDA", "NAD83", "CGCS2000")
"""Beginnings of the names of datums within some metres of WGS84, as receivers write them."""
NAMES = {
    _LATITUDE_REF: "GPS GPSLatitudeRef",
    _LATITUDE: "GPS GPSLatitude",
    _LONGITUDE_REF: "GPS GPSLongitudeRef",
    _LONGITUDE: "GPS GPSLongitude",
    _ALTITUDE_REF: "GPS GPSAltitudeRef",
    _ALTITUDE: "GPS GPSAltitude",
    _STATUS: "GPS GPSStatus",
    _DATUM: "GPS GPSMapDatum",
    _ERROR: "GPS Tag 0x001F",
}
"""Tag names in ExifRead."""


def position_of(tags: Directory) -> GpsPosition | None:
    """The position in a GPS directory; None if it is missing or impossible.

    None too where the receiver had no fix (GPSStatus V), the hemisphere is missing, or the datum is another
    than WGS84: hundreds of metres lie between it and Tokyo's or Pulkovo's of 1942.
    """
    latitude, longitude = (_degrees(tags, tag) for tag in (_LATITUDE, _LONGITUDE))
    if latitude is None or longitude is None or latitude > 90 or longitude > 180:
        return None
    if latitude == 0 and longitude == 0:  # what cameras write that found no satellite
        return None
    south, west = (text(tags, tag)[:1].upper() for tag in (_LATITUDE_REF, _LONGITUDE_REF))
    if south not in ("N", "S") or west not in ("E", "W") or text(tags, _STATUS)[:1].upper() == "V":
        return None
    datum = "".join(letter for letter in text(tags, _DATUM).upper() if letter.isalnum())
    if datum and not datum.startswith(_WGS84):
        return None
    altitude = numbers(tags, _ALTITUDE)
    below = next(iter(numbers(tags, _ALTITUDE_REF)), 0) in _BELOW
    error = numbers(tags, _ERROR)
    return GpsPosition(
        -latitude if south == "S" else latitude,
        -longitude if west == "W" else longitude,
        (-altitude[0] if below else altitude[0]) if altitude and abs(altitude[0]) < 1e5 else None,
        error[0] if error and 0 < error[0] < 1e5 else None,
    )


def _degrees(tags: Directory, tag: int) -> float | None:
    parts = numbers(tags, tag)
    if not 1 <= len(parts) <= 3 or any(part < 0 for part in parts):
        return None
    return float(sum(part / 60**place for place, part in enumerate(parts)))


def entries_of(position: GpsPosition) -> dict[int, Entry]:
    """The tags of a GPS directory; angles to a billionth of a degree, a tenth of a millimetre."""
    entries = {
        0: Entry(BYTE, [2, 3, 0, 0]),
        _LATITUDE_REF: Entry(ASCII, "S" if position.latitude < 0 else "N"),
        _LATITUDE: Entry(RATIONAL, _parts(position.latitude)),
        _LONGITUDE_REF: Entry(ASCII, "W" if position.longitude < 0 else "E"),
        _LONGITUDE: Entry(RATIONAL, _parts(position.longitude)),
    }
    if position.altitude is not None:
        entries[_ALTITUDE_REF] = Entry(BYTE, [int(position.altitude < 0)])
        entries[_ALTITUDE] = Entry(RATIONAL, [rational(abs(position.altitude))])
    if position.error is not None:
        entries[_ERROR] = Entry(RATIONAL, [rational(position.error)])
    return entries


def _parts(angle: float) -> list[Fraction]:
    """Degrees, minutes and seconds."""
    units = round(abs(angle) * 3600 * 10**6)  # millionths of a second
    seconds, rest = divmod(units, 10**6)
    return [
        Fraction(seconds // 3600),
        Fraction(seconds // 60 % 60),
        Fraction((seconds % 60) * 10**6 + rest, 10**6),
    ]
