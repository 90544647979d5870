"""Metadata of RAW files that are no TIFF: ExifRead's, else LibRaw's, whatever the bytes are."""

import random
import struct
from io import BytesIO
from types import SimpleNamespace

import exifread
import numpy as np
import pytest

from imaging.exposure import Exposure
from imaging.files.photo import encode_jpeg
from imaging.files.raw import _spoken
from imaging.mosaic import FrameMetadata

SAID = FrameMetadata(make="Acme", model="Z1", exposure=Exposure(time=0.01, f_number=2.0, iso=100.0))
LIBRAW = SimpleNamespace(
    other=SimpleNamespace(shutter_speed=0.5, aperture=4.0, iso_speed=200.0, focal_length=35.0)
)


def raf() -> bytes:
    """As Fuji's files begin: a head that says where the photograph with the EXIF lies."""
    picture = encode_jpeg(np.zeros((8, 8, 3), np.uint8), metadata=SAID)
    head = b"FUJIFILMCCD-RAW 0201FF" + bytes(62) + struct.pack(">II", 148, len(picture))
    return head.ljust(148, b"\0") + picture


def test_exif_counts_before_what_libraw_says() -> None:
    found = _spoken(BytesIO(raf()), LIBRAW)
    assert (found.make, found.exposure, found.focal_length_mm) == ("Acme", SAID.exposure, 35.0)
    plain = _spoken(BytesIO(bytes(300)), LIBRAW)
    assert (plain.make, plain.exposure) == ("", Exposure(time=0.5, f_number=4.0, iso=200.0))


def test_damaged_bytes_leave_it_to_libraw() -> None:
    rng = random.Random(3)
    whole = raf()
    for _ in range(300):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 6)):
            damaged[rng.randrange(84, 500)] = rng.choice([0, 1, 255, rng.randrange(256)])
        found = _spoken(
            BytesIO(bytes(damaged[: rng.choice([len(whole), rng.randrange(len(whole))])])), LIBRAW
        )
        assert found.exposure is not None


def test_an_error_of_our_own_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imaging.files.raw.from_names", lambda values: values["missing"])
    with pytest.raises(KeyError):
        _spoken(BytesIO(raf()), LIBRAW)
    monkeypatch.setattr(exifread, "process_file", lambda file, details: [][1])
    with pytest.raises(KeyError):
        _spoken(BytesIO(raf()), LIBRAW)
