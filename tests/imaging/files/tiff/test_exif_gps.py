"""Place of a photograph, and tags of its GPS directory that make it unknown."""

import pytest

from imaging.files.tiff.directory import ASCII, BYTE, LONG, RATIONAL, Entry, encode_directory
from imaging.files.tiff.exif import decode_exif, from_names
from imaging.files.tiff.exif_gps import GPS_IFD
from imaging.sensor.mosaic import GpsPosition

PLACE = {
    1: Entry(ASCII, "N"),
    2: Entry(RATIONAL, [31, 30, 0]),
    3: Entry(ASCII, "E"),
    4: Entry(RATIONAL, [35, 15, 36]),
    6: Entry(RATIONAL, [400]),
}


def position(**tags: Entry | None) -> GpsPosition | None:
    """The position of a block whose GPS directory has other tags, by their numbers; None: without it."""
    named = {int(name[1:]): entry for name, entry in tags.items()}
    gps = {tag: entry for tag, entry in {**PLACE, **named}.items() if entry is not None}
    at = 8 + len(encode_directory({GPS_IFD: Entry(LONG, [0])}, 8))
    head = encode_directory({GPS_IFD: Entry(LONG, [at])}, 8)
    return decode_exif(b"II*\0\x08\0\0\0" + head + encode_directory(gps, at)).position


@pytest.mark.parametrize(("reference", "height"), [(None, 400), (0, 400), (1, -400), (2, 400), (3, -400)])
def test_heights_below_the_sea_and_below_the_ellipsoid_are_negative(
    reference: int | None, height: float
) -> None:
    assert position(_5=None if reference is None else Entry(BYTE, [reference])) == GpsPosition(
        31.5, 35.26, height
    )
    degrees = {"GPS GPSLatitudeRef": "N", "GPS GPSLatitude": [31], "GPS GPSLongitudeRef": "E"}
    named = from_names(
        degrees | {"GPS GPSLongitude": [35], "GPS GPSAltitude": [400], "GPS GPSAltitudeRef": [reference or 0]}
    )
    assert named.position == GpsPosition(31, 35, height)


@pytest.mark.parametrize(
    ("south", "west", "signs"),
    [("N", "E", (1, 1)), ("S", "W", (-1, -1)), ("s", "east", (-1, 1)), ("North", "W", (1, -1))],
)
def test_the_hemisphere_is_that_of_its_tag(south: str, west: str, signs: tuple[int, int]) -> None:
    place = position(_1=Entry(ASCII, south), _3=Entry(ASCII, west))
    assert place is not None
    assert (place.latitude, place.longitude) == (signs[0] * 31.5, signs[1] * 35.26)


@pytest.mark.parametrize("tag", ["_1", "_3"])
@pytest.mark.parametrize("entry", [None, Entry(ASCII, ""), Entry(ASCII, "?"), Entry(BYTE, [1])])
def test_without_a_hemisphere_the_place_is_unknown(tag: str, entry: Entry | None) -> None:
    assert position(**{tag: entry}) is None


@pytest.mark.parametrize(
    ("datum", "known"),
    [
        ("", True),
        ("WGS-84", True),
        ("WGS 84", True),
        ("wgs84", True),
        ("JGD2000", True),
        ("TOKYO", False),
        ("WGS-72", False),
        ("Pulkovo 1942", False),
    ],
)
def test_a_place_of_another_datum_is_unknown(datum: str, known: bool) -> None:
    assert (position(_18=Entry(ASCII, datum)) is not None) == known


def test_a_receiver_without_a_fix_tells_no_place() -> None:
    assert position(_9=Entry(ASCII, "V")) is None
    assert position(_9=Entry(ASCII, "A")) == position()


def test_parts_that_cannot_be_give_no_place() -> None:
    for parts in ([91, 0, 0], [0, 0, 0, 0], []):
        assert position(_2=Entry(RATIONAL, parts)) is None
    assert position(_2=Entry(RATIONAL, [0]), _4=Entry(RATIONAL, [0])) is None
