"""TIFF directories: exact numbers in both byte orders, and defence against damage."""

import struct
from fractions import Fraction
from io import BytesIO

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging.files.tiff.directory import (
    ASCII,
    BYTE,
    DOUBLE,
    EXIF_IFD,
    LONG,
    RATIONAL,
    SHORT,
    SRATIONAL,
    SUB_IFDS,
    UNDEFINED,
    Entry,
    TiffError,
    TiffReader,
    encode_directory,
    integers,
    numbers,
    rational,
    text,
)
from imaging.files.tiff.exif import _NAMES, decode_exif, from_names
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata

HEAD = b"II*\0\x08\0\0\0"


def read(entries: dict[int, Entry]) -> dict[int, object]:
    (directory,) = TiffReader(BytesIO(HEAD + encode_directory(entries, 8))).directories()
    return dict(directory)


def test_every_type_comes_back() -> None:
    entries = {
        900: Entry(DOUBLE, [0.1, -1e300]),
        256: Entry(LONG, [2**32 - 1]),
        257: Entry(SHORT, [1, 2, 65535]),
        258: Entry(BYTE, [0, 255]),
        271: Entry(ASCII, "four"),
        272: Entry(ASCII, "日本"),
        300: Entry(RATIONAL, [Fraction(1, 8000), 3]),
        301: Entry(SRATIONAL, [Fraction(-2, 3)]),
        302: Entry(UNDEFINED, b"0231"),
    }
    assert read(entries) == {
        900: (0.1, -1e300),
        256: (2**32 - 1,),
        257: (1, 2, 65535),
        258: (0, 255),
        271: "four",
        272: "日本",
        300: (Fraction(1, 8000), Fraction(3)),
        301: (Fraction(-2, 3),),
        302: b"0231",
    }


def test_big_endian_and_x_over_zero() -> None:
    data = b"MM\0*" + struct.pack(">IHHHIIHHIHHI", 8, 2, 256, 3, 1, 7 << 16, 33434, 5, 1, 0, 38, 0)
    data += struct.pack(">II", 1, 0)
    directory, following = TiffReader(BytesIO(data)).directory(8)
    assert directory == {256: (7,), 33434: (None,)}
    assert following == 0
    assert integers(directory, 256) == (7,)
    assert numbers(directory, 33434) == ()
    assert text(directory, 256) == ""


@settings(max_examples=300)
@given(st.floats(1e-5, 1e5))
def test_a_rational_is_nearest(value: float) -> None:
    fraction = rational(value)
    assert 0 < fraction.numerator < 2**32
    assert 0 < fraction.denominator < 2**32
    assert float(fraction) == pytest.approx(value, rel=1e-9)
    assert rational(-value, signed=True) == pytest.approx(-value, rel=1e-7)


def test_a_rational_is_simple() -> None:
    assert rational(1 / 8000) == Fraction(1, 8000)
    assert rational(1 / 3) == Fraction(1, 3)
    assert rational(30.0) == 30
    assert rational(0.0) == 0
    assert rational(1e-5) == Fraction(1, 100_000)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0, 2.0**32, 1e300])
def test_what_is_no_rational_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="rational"):
        rational(value)


@pytest.mark.parametrize("tag", [271, 305, 282, 33434, 37500, 700])
def test_a_value_beyond_the_block_costs_its_tag_alone(tag: int) -> None:
    """Editors drop the bytes of a maker's note and leave its entry."""
    entries = {256: Entry(LONG, [640]), 272: Entry(ASCII, "four and more")}
    data = bytearray(HEAD + encode_directory(entries | {tag: Entry(UNDEFINED, b"12345678")}, 8))
    place = data.index(struct.pack("<HHI", tag, UNDEFINED, 8)) + 8
    data[place : place + 4] = struct.pack("<I", len(data) - 7)
    (directory,) = TiffReader(BytesIO(bytes(data))).directories()
    assert directory == {256: (640,), 272: "four and more"}


@pytest.mark.parametrize("tag", [273, 279, 324, 325, 330, 33422, 34675, 50714, 50717, 50721, 50829, 51009])
def test_a_value_that_pixels_need_is_not_left_out(tag: int) -> None:
    data = bytearray(HEAD + encode_directory({tag: Entry(LONG, [1, 2])}, 8))
    data[18:22] = struct.pack("<I", len(data) - 7)
    with pytest.raises(TiffError, match="past the end"):
        TiffReader(BytesIO(bytes(data))).directories()


def test_a_photograph_without_the_bytes_of_its_note_keeps_its_exposure() -> None:
    entries = {33434: Entry(RATIONAL, [Fraction(1, 60)]), 37500: Entry(UNDEFINED, b"x" * 400)}
    main = {EXIF_IFD: Entry(LONG, [26])}
    block = b"Exif\0\0" + HEAD + encode_directory(main, 8) + encode_directory(entries, 26)
    assert decode_exif(block[:-400]).exposure == Exposure(time=1 / 60)


def test_directories_are_found_once_each() -> None:
    # the second points back to the first, and the first at the second as chain and as child
    first = struct.pack("<HHHIII", 1, SUB_IFDS, 4, 1, 26, 26)
    second = struct.pack("<HHHIII", 1, 256, 4, 1, 5, 8)
    assert len(TiffReader(BytesIO(HEAD + first + second)).directories()) == 2


def test_endless_chains_end() -> None:
    links = b"".join(struct.pack("<HHHIII", 1, 256, 4, 1, 5, 8 + 18 * (i + 1)) for i in range(200))
    with pytest.raises(TiffError, match="too many"):
        TiffReader(BytesIO(HEAD + links)).directories()


@pytest.mark.parametrize(
    "data", [b"", b"II", b"PK\x03\x04" + bytes(40), HEAD, HEAD + b"\xff\xff", b"II*\0" + b"\xff" * 4]
)
def test_what_is_no_tiff_is_refused(data: bytes) -> None:
    with pytest.raises(TiffError):
        TiffReader(BytesIO(data)).directories()


@settings(max_examples=500)
@given(st.binary(max_size=200))
def test_any_bytes_give_directories_or_the_one_error(data: bytes) -> None:
    try:
        TiffReader(BytesIO(HEAD + data)).directories()
    except TiffError:
        return


@settings(max_examples=300)
@given(st.binary(max_size=300))
def test_any_exif_block_gives_metadata(data: bytes) -> None:
    assert isinstance(decode_exif(b"Exif\0\0" + HEAD + data), FrameMetadata)
    assert isinstance(decode_exif(data), FrameMetadata)


def test_names_of_exifread() -> None:
    metadata = from_names(
        {
            "Image Make": "Maker\0",
            "Image Orientation": [8],
            "EXIF ExposureTime": [Fraction(1, 250)],
            "EXIF ISOSpeedRatings": [400],
            "EXIF DateTimeOriginal": "2024:01:02 03:04:05",
            "EXIF SubSecTimeOriginal": "25",
            "EXIF FocalLength": [],
            "Thumbnail": b"x",
        }
    )
    assert metadata.make == "Maker"
    assert metadata.orientation == 8
    assert metadata.exposure == Exposure(time=1 / 250, iso=400)
    assert metadata.captured_at is not None
    assert metadata.captured_at.microsecond == 250_000
    assert metadata.focal_length_mm is None


@pytest.mark.parametrize(
    "moment", ["", "0000:00:00 00:00:00", "    :  :     :  :  ", "2024-01-02", "2024:13:45 99:00:00"]
)
def test_a_clock_that_was_never_set(moment: str) -> None:
    assert from_names({"EXIF DateTimeOriginal": moment}).captured_at is None


@pytest.mark.parametrize("value", [[0], [], ["x"], [Fraction(0)], [-1], [10**12]])
def test_an_exposure_that_cannot_be_is_none(value: list[object]) -> None:
    assert from_names({"EXIF ExposureTime": value, "EXIF FNumber": [Fraction(4)]}).exposure is None


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        # ShutterSpeedValue, ApertureValue: time is 2^-Tv, f-number 2^(Av/2)
        ({37377: 7, 37378: 3}, Exposure(time=1 / 128, f_number=2**1.5)),
        ({37377: Fraction(-5, 2)}, Exposure(time=2**2.5)),
        ({33434: Fraction(1, 125), 37377: 7, 37378: 4}, Exposure(time=1 / 125, f_number=4)),
        ({33434: Fraction(1, 125), 33437: Fraction(28, 10), 37378: 4}, Exposure(time=1 / 125, f_number=2.8)),
        ({33434: 1, 33437: 0, 37378: 0}, Exposure(time=1)),  # a lens without contacts
        ({37378: 4}, None),
        ({33434: 0, 37377: 0}, None),  # as converters write what they do not know
        ({37377: 10**6}, None),
        # StandardOutputSensitivity, RecommendedExposureIndex, ISOSpeed, of which SensitivityType tells one
        ({33434: 1, 34865: 400}, Exposure(time=1, iso=400)),
        ({33434: 1, 34866: 500}, Exposure(time=1, iso=500)),
        ({33434: 1, 34867: 640}, Exposure(time=1, iso=640)),
        ({33434: 1, 34855: 200, 34867: 640}, Exposure(time=1, iso=200)),
        ({33434: 1, 34855: 65535, 34867: 102400}, Exposure(time=1, iso=102400)),
        ({33434: 1, 34855: 65535}, Exposure(time=1, iso=65535)),
        ({33434: 1, 34864: 3, 34866: 80000, 34867: 102400}, Exposure(time=1, iso=102400)),
        ({33434: 1, 34864: 1, 34865: 90000, 34866: 80000}, Exposure(time=1, iso=90000)),
        ({33434: 1, 34864: 7, 34866: 80000, 34867: 102400}, Exposure(time=1, iso=80000)),
    ],
)
def test_other_tags_tell_the_exposure_too(tags: dict[int, int | Fraction], expected: Exposure | None) -> None:
    block = encode_directory({tag: Entry(SRATIONAL, [value]) for tag, value in tags.items()}, 26)
    head = encode_directory({EXIF_IFD: Entry(LONG, [26])}, 8)
    for metadata in (
        decode_exif(HEAD + head + block),
        from_names({_NAMES[tag]: [value] for tag, value in tags.items()}),
    ):
        if expected is None:
            assert metadata.exposure is None
        else:
            assert metadata.exposure is not None
            assert metadata.exposure.model_dump() == pytest.approx(expected.model_dump())


def test_an_orientation_that_is_no_number_is_none() -> None:
    block = encode_directory({274: Entry(DOUBLE, [float("nan")])}, 8)
    assert decode_exif(HEAD + block).orientation == 1
