"""Gains of a white balance in the notes of makers, as ExifTool documents them.

Notes of Canon and Panasonic, and Pentax's older ones, count offsets from the head of the file; those of
Nikon, Olympus and Pentax's newer ones from a head of their own.
"""

from io import BytesIO

from imaging.files.tiff.directory import Directory, TiffError, TiffReader, integers, numbers

MAKER_NOTE = 37500
_NIKON_GAINS = 12
_CANON_COLOUR = 0x4001
_CANON_PLACES = {
    0x19: (582,),
    0x22: (653,),
    0x3F: (
        *(674, 692, 702, 796, 1227, 1250, 1251, 1273, 1275, 1312, 1313, 1316, 1337, 1338, 1346, 1353),
        *(1506, 1560, 1592, 1602),
    ),
    0x47: (1816, 1820, 1824, 5120),
    0x55: (2024, 3656),
    0x69: (3778, 3973),
}
"""Positions of red, green, green and blue as shot in the note, by its number of values."""
_OLYMPUS_PROCESSING, _OLYMPUS_GAINS, _OLYMPUS_RED, _OLYMPUS_BLUE = 0x2040, 0x100, 0x1017, 0x1018
_PENTAX_BLUE, _PENTAX_RED = 0x1B, 0x1C
_PANASONIC_LEVELS = (0x8004, 0x8005, 0x8006)
_ONE = 256.0
"""A gain of 1, of Olympus and Pentax."""


def balance(reader: TiffReader, offset: int, exif: Directory, make: str) -> tuple[float, float] | None:
    """Gains of red and blue over green that the camera applied; None where no note states them in a known
    way.

    reader: of the file or its EXIF block. offset: of the EXIF directory, whose values `exif` has.
    """
    note = exif.get(MAKER_NOTE)
    try:
        levels = _levels(reader, offset, note, make) if isinstance(note, bytes) else None
    except TiffError:  # notes that were moved by other programs lead anywhere
        return None
    if levels is None or not all(0 < level < 1e6 for level in levels):
        return None
    red, green, blue = levels
    return red / green, blue / green


def _levels(reader: TiffReader, offset: int, note: bytes, make: str) -> tuple[float, float, float] | None:
    """Red, green and blue."""
    place = reader.place(offset, MAKER_NOTE)
    if note.startswith(b"Nikon\0\x02"):
        inner = TiffReader(BytesIO(note[10:]))
        gains = numbers(inner.directory(inner.first)[0], _NIKON_GAINS)
        return (gains[0], gains[2], gains[1]) if len(gains) >= 3 else None
    if note.startswith((b"OLYMPUS\0", b"OM SYSTEM\0")):
        return _of_olympus(note, 12 if note.startswith(b"OLYMPUS") else 16)
    if note.startswith(b"PENTAX \0"):
        return _of_pentax(_note_reader(note, 10, note[8:10]).directory(10)[0])
    if note.startswith(b"AOC\0"):
        return _of_pentax(reader.directory(place + 6)[0])
    if note.startswith(b"Panasonic\0"):
        tags = reader.directory(place + 12)[0]
        levels = [next(iter(numbers(tags, tag)), 0.0) for tag in _PANASONIC_LEVELS]
        return levels[0], levels[1], levels[2]
    if make.upper().startswith("CANON"):
        return _of_canon(reader.directory(place)[0])
    return None


def _note_reader(note: bytes, first: int, order: bytes) -> TiffReader:
    """A reader of a note that counts offsets from its first byte; order: II or MM."""
    little = order == b"II"
    head = b"II*\0" if little else b"MM\0*"
    return TiffReader(BytesIO(head + first.to_bytes(4, "little" if little else "big") + note[8:]))


def _of_olympus(note: bytes, first: int) -> tuple[float, float, float] | None:
    reader = _note_reader(note, first, note[first - 4 : first - 2])
    tags = reader.directory(first)[0]
    below: Directory = {}
    if _OLYMPUS_PROCESSING in tags:
        led = integers(tags, _OLYMPUS_PROCESSING)[:1] or (reader.place(first, _OLYMPUS_PROCESSING),)
        below = reader.directory(led[0])[0]
    gains = numbers(below, _OLYMPUS_GAINS)
    if len(gains) < 2:
        gains = (*numbers(tags, _OLYMPUS_RED)[:1], *numbers(tags, _OLYMPUS_BLUE)[:1])
    return (gains[0], _ONE, gains[1]) if len(gains) >= 2 else None


def _of_pentax(tags: Directory) -> tuple[float, float, float] | None:
    red, blue = numbers(tags, _PENTAX_RED)[:1], numbers(tags, _PENTAX_BLUE)[:1]
    return (red[0], _ONE, blue[0]) if red and blue else None


def _of_canon(tags: Directory) -> tuple[float, float, float] | None:
    colour = integers(tags, _CANON_COLOUR)
    at = next((place for place, counts in _CANON_PLACES.items() if len(colour) in counts), None)
    if at is None:
        return None
    red, green, _, blue = colour[at : at + 4]
    return float(red), float(green), float(blue)
