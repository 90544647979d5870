"""Metadata of RAW files that are no TIFF: their EXIF, else what LibRaw says, whatever the bytes are."""

import random
import struct
from io import BytesIO
from types import SimpleNamespace

import exifread
import numpy as np
import pytest

from imaging.files.photo import encode_jpeg
from imaging.files.tags.raw_exif import spoken
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata

SAID = FrameMetadata(make="Acme", model="Z1", exposure=Exposure(time=0.01, f_number=2.0, iso=100.0))
LIBRAW = SimpleNamespace(
    other=SimpleNamespace(shutter_speed=0.5, aperture=4.0, iso_speed=200.0, focal_length=35.0)
)


def raf() -> bytes:
    """Begin as Fuji's files do: a head with the place of the photograph that has the EXIF."""
    picture = encode_jpeg(np.zeros((8, 8, 3), np.uint8), metadata=SAID)
    head = b"FUJIFILMCCD-RAW 0201FF" + bytes(62) + struct.pack(">II", 148, len(picture))
    return head.ljust(148, b"\0") + picture


def test_exif_counts_before_what_libraw_says() -> None:
    metadata = spoken(BytesIO(raf()), LIBRAW)
    assert (metadata.make, metadata.exposure, metadata.focal_length_mm) == ("Acme", SAID.exposure, 35.0)
    plain = spoken(BytesIO(bytes(300)), LIBRAW)
    assert (plain.make, plain.exposure) == ("", Exposure(time=0.5, f_number=4.0, iso=200.0))


def test_damaged_bytes_leave_it_to_libraw() -> None:
    rng = random.Random(3)
    whole = raf()
    for _ in range(300):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 6)):
            damaged[rng.randrange(84, 500)] = rng.choice([0, 1, 255, rng.randrange(256)])
        metadata = spoken(
            BytesIO(bytes(damaged[: rng.choice([len(whole), rng.randrange(len(whole))])])), LIBRAW
        )
        assert metadata.exposure is not None


def test_an_error_of_our_own_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def trip(*_: object, **__: object) -> None:
        raise IndexError("as of damaged bytes")

    monkeypatch.setattr(exifread, "process_file", trip)
    assert spoken(BytesIO(b"IIRO"), LIBRAW).exposure == Exposure(time=0.5, f_number=4.0, iso=200.0)
    monkeypatch.setattr("imaging.files.tags.raw_exif.from_names", trip)
    with pytest.raises(IndexError):
        spoken(BytesIO(b"IIRO"), LIBRAW)
