"""Gain maps of telephones: the picture is read without them, and the import says so."""

import struct
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from capture.imports.photos import import_photos
from imaging.files.heif_webp import heif_is_read
from imaging.files.photo import encode_jpeg, read_photo

PIXELS = np.random.default_rng(8).integers(0, 256, (4, 6, 3), dtype=np.uint8).repeat(16, 0).repeat(16, 1)
XAP = b"http://ns.adobe.com/xap/1.0/\0"
ADOBE = b"""<rdf:Description xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"/>"""
APPLE = b"""<apdi:AuxiliaryImageType>urn:com:apple:photo:2020:aux:hdrgainmap</apdi:AuxiliaryImageType>"""
SENTENCE = "the HDR gain map is ignored: only the picture itself is read"


def with_segment(jpeg: bytes, marker: int, body: bytes) -> bytes:
    return jpeg[:2] + struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body + jpeg[2:]


def ultra_hdr() -> bytes:
    """Write it as Android does: XMP in both pictures, an MPF index, the map behind the picture."""
    return with_segment(
        with_segment(encode_jpeg(PIXELS), 0xE2, b"MPF\0II*\0\x08\0\0\0"), 0xE1, XAP + ADOBE
    ) + (with_segment(encode_jpeg(PIXELS[::4, ::4, 0]), 0xE1, XAP + ADOBE))


def iso() -> bytes:
    return with_segment(encode_jpeg(PIXELS), 0xE2, b"urn:iso:std:iso:ts:21496:-1\0\0\0\0\0")


def apple() -> bytes:
    """Write it as iPhones do: nothing but the index in the picture, XMP in the map behind it."""
    picture = with_segment(encode_jpeg(PIXELS), 0xE2, b"MPF\0MM\0*\0\0\0\x08")
    return picture + with_segment(encode_jpeg(PIXELS[::4, ::4, 0]), 0xE1, XAP + APPLE)


@pytest.mark.parametrize("made", [ultra_hdr, iso, apple])
def test_the_picture_is_read_and_the_map_is_named(tmp_path, made):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "a.jpg").write_bytes(made())
    (folder / "b.jpg").write_bytes(encode_jpeg(255 - PIXELS))
    (tmp_path / "plain.jpg").write_bytes(encode_jpeg(PIXELS))
    assert np.array_equal(read_photo(folder / "a.jpg").pixels, read_photo(tmp_path / "plain.jpg").pixels)
    assert read_photo(tmp_path / "plain.jpg").doubt == ""
    said = import_photos(folder, tmp_path / "s").guesses
    assert sum(f"Of 1 of 2 photos {SENTENCE}" in line for line in said) == 1


@pytest.mark.skipif(not heif_is_read(), reason="pillow-heif is not installed")
@pytest.mark.parametrize("kind", ["apple", "iso"])
def test_a_map_in_a_heic_is_named(tmp_path, kind):
    import pillow_heif

    pillow_heif.register_heif_opener()
    buffer = BytesIO()
    Image.fromarray(PIXELS).save(buffer, "HEIF", quality=95)
    plain = buffer.getvalue()
    (tmp_path / "plain.heic").write_bytes(plain)
    if kind == "iso":
        # one of the brands becomes that of pictures with a map
        data = plain[:20] + plain[20:64].replace(b"miaf", b"tmap", 1) + plain[64:]
        assert data != plain
    else:
        data = plain + struct.pack(">I4s", len(APPLE) + 8, b"free") + APPLE
    (tmp_path / "a.heic").write_bytes(data)
    assert read_photo(tmp_path / "plain.heic").doubt == ""
    photo = read_photo(tmp_path / "a.heic")
    assert photo.doubt.startswith("HDR gain map is ignored")
    assert np.array_equal(photo.pixels, read_photo(tmp_path / "plain.heic").pixels)
