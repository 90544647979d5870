"""Camera and exposure in EXIF, read and written."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from fractions import Fraction
from io import BytesIO
from typing import Any

from imaging.files.tags.xmp import noted
from imaging.files.tiff import exif_gps, maker_notes
from imaging.files.tiff.directory import (
    ASCII,
    EXIF_IFD,
    LONG,
    RATIONAL,
    SHORT,
    UNDEFINED,
    Directory,
    Entry,
    TiffError,
    TiffReader,
    encode_directory,
    integers,
    numbers,
    rational,
    text,
)
from imaging.files.tiff.pages import photograph
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata

MAKE, MODEL, ORIENTATION, DATE_TIME, XMP = 271, 272, 274, 306, 700
EXPOSURE_TIME, F_NUMBER, ISO = 33434, 33437, 34855
SHUTTER_SPEED_VALUE, APERTURE_VALUE = 37377, 37378
SENSITIVITY_TYPE, OUTPUT_SENSITIVITY, RECOMMENDED_INDEX, ISO_SPEED = 34864, 34865, 34866, 34867
EXIF_VERSION, DATE_TIME_ORIGINAL, ZONE_ORIGINAL, SUB_SECONDS = 36864, 36867, 36881, 37521
FOCAL_LENGTH, FOCAL_LENGTH_35MM, BODY_SERIAL = 37386, 41989, 42033
DIGITAL_ZOOM, LENS_MODEL = 41988, 42036
COLOUR_SPACE, INTEROP_IFD = 40961, 40965
PIXELS_ACROSS, PIXELS_DOWN = 40962, 40963
FOCAL_PLANE_ACROSS, FOCAL_PLANE_DOWN, FOCAL_PLANE_UNIT = 41486, 41487, 41488
WHITE_BALANCE = 41987
CAMERA_SERIAL = 50735

_NAMES = {
    MAKE: "Image Make",
    MODEL: "Image Model",
    ORIENTATION: "Image Orientation",
    DATE_TIME: "Image DateTime",
    EXPOSURE_TIME: "EXIF ExposureTime",
    F_NUMBER: "EXIF FNumber",
    ISO: "EXIF ISOSpeedRatings",
    SHUTTER_SPEED_VALUE: "EXIF ShutterSpeedValue",
    APERTURE_VALUE: "EXIF ApertureValue",
    SENSITIVITY_TYPE: "EXIF SensitivityType",
    OUTPUT_SENSITIVITY: "EXIF Tag 0x8821",
    RECOMMENDED_INDEX: "EXIF RecommendedExposureIndex",
    ISO_SPEED: "EXIF ISOSpeed",
    DATE_TIME_ORIGINAL: "EXIF DateTimeOriginal",
    SUB_SECONDS: "EXIF SubSecTimeOriginal",
    FOCAL_LENGTH: "EXIF FocalLength",
    FOCAL_LENGTH_35MM: "EXIF FocalLengthIn35mmFilm",
    DIGITAL_ZOOM: "EXIF DigitalZoomRatio",
    LENS_MODEL: "EXIF LensModel",
    PIXELS_ACROSS: "EXIF ExifImageWidth",
    PIXELS_DOWN: "EXIF ExifImageLength",
    FOCAL_PLANE_ACROSS: "EXIF FocalPlaneXResolution",
    FOCAL_PLANE_DOWN: "EXIF FocalPlaneYResolution",
    FOCAL_PLANE_UNIT: "EXIF FocalPlaneResolutionUnit",
    BODY_SERIAL: "EXIF BodySerialNumber",
    WHITE_BALANCE: "EXIF WhiteBalance",
}

_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}
"""Millimetres per unit of focal plane resolution; 4 and 5 are in no standard, and in use."""
_SENSORS_MM = 1.0, 200.0

_MOST_APEX = 30.0
"""Largest APEX value of a time or an aperture: 34 years, f/32768."""


def exif_entries(metadata: FrameMetadata) -> dict[int, Entry]:
    """The tags of an EXIF directory.

    An ISO is rounded to a whole number, as EXIF wants it. ValueError for a time that no rational holds.
    """
    entries = {EXIF_VERSION: Entry(UNDEFINED, b"0231")}
    exposure = metadata.exposure
    if exposure is not None:
        time = rational(exposure.time)
        if time == 0:
            raise ValueError(f"an exposure of {exposure.time} s is too short for EXIF")
        entries[EXPOSURE_TIME] = Entry(RATIONAL, [time])
        if exposure.f_number is not None:
            entries[F_NUMBER] = Entry(RATIONAL, [rational(exposure.f_number)])
        if exposure.iso is not None:
            iso = max(1, round(exposure.iso))
            entries[ISO] = Entry(SHORT, [min(iso, 65535)])
            entries[SENSITIVITY_TYPE] = Entry(SHORT, [2])
            entries[RECOMMENDED_INDEX] = Entry(LONG, [iso])
    if metadata.captured_at is not None:
        entries[DATE_TIME_ORIGINAL] = Entry(ASCII, metadata.captured_at.strftime("%Y:%m:%d %H:%M:%S"))
        entries[SUB_SECONDS] = Entry(ASCII, f"{metadata.captured_at.microsecond:06d}")
        zone = metadata.captured_at.strftime("%z")
        if zone:
            entries[ZONE_ORIGINAL] = Entry(ASCII, f"{zone[:3]}:{zone[3:5]}")
    if metadata.focal_length_mm is not None:
        entries[FOCAL_LENGTH] = Entry(RATIONAL, [rational(metadata.focal_length_mm)])
    if metadata.focal_length_35mm is not None:
        entries[FOCAL_LENGTH_35MM] = Entry(SHORT, [round(metadata.focal_length_35mm)])
    if metadata.digital_zoom is not None:
        entries[DIGITAL_ZOOM] = Entry(RATIONAL, [rational(metadata.digital_zoom)])
    if metadata.lens:
        entries[LENS_MODEL] = Entry(ASCII, metadata.lens)
    if metadata.manual_white_balance:
        entries[WHITE_BALANCE] = Entry(SHORT, [1])
    if metadata.serial:
        entries[BODY_SERIAL] = Entry(ASCII, metadata.serial)
    return entries


def camera_entries(metadata: FrameMetadata) -> dict[int, Entry]:
    """The tags about the camera that stand in the main directory."""
    entries = {ORIENTATION: Entry(SHORT, [metadata.orientation])}
    if metadata.make:
        entries[MAKE] = Entry(ASCII, metadata.make)
    if metadata.model:
        entries[MODEL] = Entry(ASCII, metadata.model)
    if metadata.captured_at is not None:
        entries[DATE_TIME] = Entry(ASCII, metadata.captured_at.strftime("%Y:%m:%d %H:%M:%S"))
    return entries


def encode_exif(metadata: FrameMetadata) -> bytes:
    """An EXIF block: 'Exif', two zero bytes and a small TIFF."""
    parts = {EXIF_IFD: exif_entries(metadata)}
    if metadata.position is not None:
        parts[exif_gps.GPS_IFD] = exif_gps.entries_of(metadata.position)
    main = camera_entries(metadata)
    at = 8 + len(encode_directory({**main, **{tag: Entry(LONG, [0]) for tag in parts}}, 8))
    body = b""
    for tag, entries in parts.items():
        main[tag] = Entry(LONG, [at + len(body)])
        body += encode_directory(entries, at + len(body))
    return b"Exif\0\0II*\0\x08\0\0\0" + encode_directory(main, 8) + body


def read_exif(reader: TiffReader) -> FrameMetadata:
    """Metadata of a TIFF-shaped file or block (most RAW files are); TiffError if it is damaged.

    What the photograph itself does not say counts as its first image has it.
    """
    main, _ = reader.directory(reader.first)
    with suppress(TiffError):  # a thumbnail that is damaged costs nothing
        main |= photograph(reader)[1]
    exif: Directory = {}
    balance = None
    for offset in integers(main, EXIF_IFD)[:1]:
        exif, _ = reader.directory(offset)
        balance = maker_notes.balance(reader, offset, exif, text(main, MAKE))
    metadata = _metadata({**main, **exif, ORIENTATION: main.get(ORIENTATION, ())})
    metadata = replace(metadata, balance=balance)
    for offset in integers(main, exif_gps.GPS_IFD)[:1]:
        try:
            gps, _ = reader.directory(offset)
        except TiffError:
            continue  # the picture can do without its position
        metadata = replace(metadata, position=exif_gps.position_of(gps))
    packet = main.get(XMP, b"")
    return noted(
        metadata, packet if isinstance(packet, bytes) else bytes(x & 255 for x in integers(main, XMP))
    )


def decode_exif(block: bytes) -> FrameMetadata:
    """Metadata of an EXIF block, with or without its 'Exif' prefix; empty if it is damaged."""
    try:
        return read_exif(TiffReader(BytesIO(block.removeprefix(b"Exif\0\0"))))
    except TiffError:
        return FrameMetadata()


def is_adobe_rgb(block: bytes) -> bool:
    """Return whether an EXIF block declares Adobe RGB: DCF's option file R03, or colour space 2 of some
    makers.
    """
    try:
        reader = TiffReader(BytesIO(block.removeprefix(b"Exif\0\0")))
        main, _ = reader.directory(reader.first)
        for offset in integers(main, EXIF_IFD)[:1]:
            exif, _ = reader.directory(offset)
            interop = [reader.directory(place)[0] for place in integers(exif, INTEROP_IFD)[:1]]
            if integers(exif, COLOUR_SPACE) == (1,):
                return False
            return integers(exif, COLOUR_SPACE) == (2,) or any(text(one, 1) == "R03" for one in interop)
    except TiffError:
        pass
    return False


def from_names(values: Mapping[str, Any]) -> FrameMetadata:
    """Metadata of tags under the names that ExifRead gives them."""
    tags: Directory = {}
    for tag, name in (_NAMES | exif_gps.NAMES).items():
        value = values.get(name)
        if isinstance(value, str):
            tags[tag] = value.strip("\0 ")
        elif isinstance(value, list | tuple):
            # Ratio is a Fraction that may be x/0
            parts = [part for part in value if isinstance(part, int | Fraction) and part.denominator]
            tags[tag] = tuple(part if isinstance(part, Fraction) else Fraction(part) for part in parts)
    return replace(_metadata(tags), position=exif_gps.position_of(tags))


def _positive(directory: Directory, tag: int) -> float | None:
    values = numbers(directory, tag)
    return values[0] if values and 0 < values[0] < 1e9 else None


def _exposure(tags: Directory) -> Exposure | None:
    """Time, f-number and ISO; APEX values where the plain time or aperture is missing.

    Beside a plain value of 0, which means unknown, an APEX value of 0 is unknown too.
    """
    time, f_number = _positive(tags, EXPOSURE_TIME), _positive(tags, F_NUMBER)
    speed, aperture = (numbers(tags, tag)[:1] for tag in (SHUTTER_SPEED_VALUE, APERTURE_VALUE))
    if EXPOSURE_TIME not in tags and speed and abs(speed[0]) < _MOST_APEX:
        time = 2.0 ** -speed[0]
    if F_NUMBER not in tags and aperture and 0 < aperture[0] < _MOST_APEX:  # 0 is a lens that reports nothing
        f_number = 2.0 ** (aperture[0] / 2)
    return None if time is None else Exposure(time=time, f_number=f_number, iso=_iso(tags))


def _iso(tags: Directory) -> float | None:
    """ISO: the 16-bit tag, or the wider number where that one is 65535.

    Exif 2.32, 4.6.5, PhotographicSensitivity and SensitivityType.
    """
    iso = _positive(tags, ISO)
    if iso is not None and iso != 65535:
        return iso
    kinds = {1: OUTPUT_SENSITIVITY, 2: RECOMMENDED_INDEX, 3: ISO_SPEED}
    sensitivity = next(
        (tag for kind, tag in kinds.items() if (kind,) == numbers(tags, SENSITIVITY_TYPE)), RECOMMENDED_INDEX
    )
    values = [_positive(tags, tag) for tag in (sensitivity, RECOMMENDED_INDEX, OUTPUT_SENSITIVITY, ISO_SPEED)]
    return next((value for value in values if value is not None), iso)


def _moment(tags: Directory) -> datetime | None:
    for tag in (DATE_TIME_ORIGINAL, DATE_TIME):
        try:
            moment = datetime.strptime(text(tags, tag), "%Y:%m:%d %H:%M:%S")
        except ValueError:
            continue
        digits = text(tags, SUB_SECONDS)
        if tag == DATE_TIME_ORIGINAL and digits.isascii() and digits.isdigit():
            moment = moment.replace(microsecond=int(Fraction(int(digits), 10 ** len(digits)) * 10**6))
        return moment
    return None


def _sensor(tags: Directory) -> float | None:
    """The longer side of the picture on the sensor, mm, by its resolution in the focal plane.

    The resolution refers to the pixels that the file says it has, whatever it was scaled to since.
    """
    unit = _UNIT_MM.get(int((*numbers(tags, FOCAL_PLANE_UNIT), 2.0)[0]))
    sides = []
    for pixels, resolution in ((PIXELS_ACROSS, FOCAL_PLANE_ACROSS), (PIXELS_DOWN, FOCAL_PLANE_DOWN)):
        count, dense = _positive(tags, pixels), _positive(tags, resolution)
        if unit is None or count is None or dense is None:
            return None
        sides.append(count / dense * unit)
    return max(sides) if _SENSORS_MM[0] <= max(sides) <= _SENSORS_MM[1] else None


def _metadata(tags: Directory) -> FrameMetadata:
    turned = (*numbers(tags, ORIENTATION), 1.0)[0]
    return FrameMetadata(
        make=text(tags, MAKE),
        model=text(tags, MODEL),
        serial=text(tags, BODY_SERIAL) or text(tags, CAMERA_SERIAL),
        exposure=_exposure(tags),
        captured_at=_moment(tags),
        focal_length_mm=_positive(tags, FOCAL_LENGTH),
        focal_length_35mm=_positive(tags, FOCAL_LENGTH_35MM),
        lens=text(tags, LENS_MODEL),
        digital_zoom=_positive(tags, DIGITAL_ZOOM),
        sensor_mm=_sensor(tags),
        orientation=int(turned) if 1 <= turned <= 8 else 1,
        manual_white_balance=numbers(tags, WHITE_BALANCE) == (1.0,),
    )
