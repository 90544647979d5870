"""White balances in the notes of makers: made notes, of which ExifTool says the same."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imaging.files.photo import read_metadata
from imaging.files.tiff.directory import ASCII, LONG, SHORT, UNDEFINED, Entry, encode_directory
from imaging.files.tiff.maker_notes import _CANON_PLACES
from tests.imaging.files.exiftool import exiftool_of_each, needs_exiftool

RED, BLUE = 1.75, 1.375
LEVELS = [round(1024 * RED), 1024, 1024, round(1024 * BLUE)]


def block(make: str, note: object) -> bytes:
    """An EXIF block; note: makes the note that will stand at an offset from the head."""
    main = {271: Entry(ASCII, make), 34665: Entry(LONG, [0])}
    at = 8 + len(encode_directory(main, 8))
    main[34665] = Entry(LONG, [at])
    body = encode_directory({37500: Entry(UNDEFINED, note(at + 18))}, at)
    return b"Exif\0\0II*\0\x08\0\0\0" + encode_directory(main, 8) + body


def directory(entries: dict[int, Entry], at: int = 0) -> bytes:
    return encode_directory(entries, at)


def canon(count: int) -> object:
    place = next(place for place, counts in _CANON_PLACES.items() if count in counts)
    values = np.full(count, 900)
    values[place : place + 4] = LEVELS
    if count == 5120:
        values[0] = 65536 - 3  # the version by which ExifTool reads it
    return lambda at: directory({0x4001: Entry(SHORT, values.tolist())}, at)


def olympus(head: bytes, *, old: bool = False) -> object:
    gains = {0x1017: Entry(SHORT, [448, 64]), 0x1018: Entry(SHORT, [352, 64])}
    if old:
        return lambda at: head + directory(gains)
    outer = {0x2040: Entry(LONG, [0])}
    inner = len(head) + len(directory(outer))
    below = directory({0x100: Entry(SHORT, [448, 352])}, inner)
    return lambda at: head + directory({0x2040: Entry(LONG, [inner])}, len(head)) + below


PENTAX = {0x1B: Entry(SHORT, [352]), 0x1C: Entry(SHORT, [448])}
PANASONIC = {0x8004: Entry(SHORT, [1792]), 0x8005: Entry(SHORT, [1024]), 0x8006: Entry(SHORT, [1408])}
NIKON = b"Nikon\0\x02\x10\0\0II*\0\x08\0\0\0"
CASES = {
    **{f"Canon {count}": ("Canon", canon(count)) for counts in _CANON_PLACES.values() for count in counts},
    "Olympus": ("OLYMPUS CORPORATION", olympus(b"OLYMPUS\0II\x03\0")),
    "OM": ("OM Digital Solutions", olympus(b"OM SYSTEM\0\0\0II\x04\0")),
    "Olympus of old": ("OLYMPUS CORPORATION", olympus(b"OLYMPUS\0II\x03\0", old=True)),
    "Pentax": ("PENTAX Corporation", lambda at: b"AOC\0II" + directory(PENTAX)),
    "Pentax now": ("RICOH IMAGING COMPANY, LTD.", lambda at: b"PENTAX \0II" + directory(PENTAX)),
    "Panasonic": ("Panasonic", lambda at: b"Panasonic\0\0\0" + directory(PANASONIC)),
    "Nikon": (
        "NIKON CORPORATION",
        lambda at: NIKON + directory({12: Entry(5, [RED, BLUE, 1, 1])}, 8),
    ),
}


def photo(path: Path, make: str, note: object) -> Path:
    Image.new("RGB", (16, 16)).save(path, exif=block(make, note))
    return path


@pytest.mark.parametrize("name", CASES)
def test_gains_are_read(tmp_path: Path, name: str) -> None:
    assert read_metadata(photo(tmp_path / "a.jpg", *CASES[name])).balance == pytest.approx((RED, BLUE))


@needs_exiftool
def test_exiftool_reads_the_same(tmp_path: Path) -> None:
    names = [name for name in CASES if not name.startswith("Canon ")]
    files = [photo(tmp_path / f"{name}.jpg", *CASES[name]) for name in names]
    for name, tags in zip(names, exiftool_of_each(files, "-n"), strict=True):
        if name == "Panasonic":
            assert [tags[f"WB{colour}Level"] for colour in ("Red", "Green", "Blue")] == [1792, 1024, 1408]
        else:
            assert (tags["RedBalance"], tags["BlueBalance"]) == pytest.approx((RED, BLUE)), name


@needs_exiftool
def test_exiftool_finds_them_at_every_place_of_canon(tmp_path: Path) -> None:
    # Each count of numbers is a generation of bodies.
    names = [name for name in CASES if name.startswith("Canon ")]
    files = [photo(tmp_path / f"{name}.jpg", *CASES[name]) for name in names]
    every = exiftool_of_each(files, "-n", "-fast", "-WB_RGGBLevelsAsShot")
    for name, tags in zip(names, every, strict=True):
        assert tags.get("WB_RGGBLevelsAsShot") == " ".join(map(str, LEVELS)), name


@pytest.mark.parametrize(
    ("make", "note"),
    [
        ("Canon", lambda at: directory({0x4001: Entry(SHORT, [1] * 777)}, at)),
        ("Canon", lambda at: directory({0x4001: Entry(SHORT, LEVELS * 200)}, at + 100_000)),
        ("Canon", lambda at: b""),
        ("Pentax", lambda at: b"AOC\0II" + directory({0x1B: Entry(SHORT, [352])})),
        ("Pentax", lambda at: b"PENTAX \0"),
        ("Panasonic", lambda at: b"Panasonic\0\0\0" + directory({0x8004: Entry(SHORT, [9])})),
        ("OLYMPUS", lambda at: b"OLYMPUS\0II\x03\0" + directory({0x2040: Entry(LONG, [9_000_000])}, 12)),
        ("NIKON", lambda at: b"Nikon\0\x02\x10\0\0II*\0\xff\xff\xff\xff"),
        ("NIKON", lambda at: NIKON + directory({12: Entry(5, [0, 1, 1])}, 8)),
        ("Acme", lambda at: directory({0x4001: Entry(SHORT, LEVELS)}, at)),
    ],
)
def test_notes_that_are_damaged_or_of_others_say_nothing(tmp_path: Path, make: str, note: object) -> None:
    metadata = read_metadata(photo(tmp_path / "a.jpg", make, note))
    assert metadata.make == make
    assert metadata.balance is None
