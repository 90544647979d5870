"""PNG (third edition) chunk by chunk: what makes pixels transparent, and what changes nothing."""

import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imaging.files.photo import encode_png, read_metadata, read_photo
from tests.imaging.files.tags.test_cicp import png

RGB8 = np.random.default_rng(4).integers(0, 250, (6, 9, 3), dtype=np.uint8)
RGB16 = np.random.default_rng(5).integers(0, 65000, (6, 9, 3), dtype=np.uint16)
SPOT = (2, 3)


@pytest.mark.parametrize(
    "pixels", [RGB8, RGB16, RGB8[..., 0], RGB16[..., 0]], ids=["8", "16", "grey 8", "grey 16"]
)
def test_one_colour_may_be_transparent(tmp_path: Path, pixels: np.ndarray) -> None:
    pixels = pixels.copy()
    pixels[SPOT] = np.iinfo(pixels.dtype).max - 3  # which nothing else is
    key = np.atleast_1d(pixels[SPOT]).astype(">u2").tobytes()
    photo = read_photo(png(tmp_path / "a.png", pixels, tRNS=key))
    assert photo.bit_depth == 8 * pixels.itemsize
    expected = np.ones((6, 9))
    expected[SPOT] = 0
    assert np.array_equal(photo.alpha, expected)
    solid = (pixels if pixels.ndim == 3 else pixels[..., None]) / np.iinfo(pixels.dtype).max
    assert np.abs(photo.pixels - solid * expected[..., None]).max() < 1e-6


@pytest.mark.parametrize("bits", [1, 2, 4, 8])
@pytest.mark.parametrize("palette", [False, True])
def test_few_bits_are_scaled_and_have_their_transparent_value(
    tmp_path: Path, bits: int, palette: bool
) -> None:
    top = 2**bits - 1
    row = np.array([0, top, 1, top, 0, 1, 1, 0])
    packed = np.packbits([int(bit) for value in row for bit in f"{value:0{bits}b}"]).tobytes()
    colours = np.random.default_rng(6).integers(0, 256, (top + 1, 3), dtype=np.uint8)
    chunks = {"PLTE": colours.tobytes(), "tRNS": b"\xff\0"} if palette else {"tRNS": b"\0\1"}
    head = struct.pack(">IIBBBBB", 8, 1, bits, 3 if palette else 0, 0, 0, 0)
    body = b"\x89PNG\r\n\x1a\n"
    for name, data in (
        {"IHDR": head} | chunks | {"IDAT": zlib.compress(b"\0" + packed), "IEND": b""}
    ).items():
        kind = name.encode()
        body += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    (tmp_path / "a.png").write_bytes(body)
    photo = read_photo(tmp_path / "a.png")
    assert np.array_equal(photo.alpha, (row != 1)[None])
    expected = colours[row] / 255 if palette else np.repeat(row[:, None] / top, 3, axis=1)
    np.testing.assert_allclose(photo.pixels[0], expected * (row != 1)[:, None], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "body"),
    [
        ("sBIT", b"\5\6\5"),
        ("bKGD", struct.pack(">3H", 200, 10, 10)),
        ("mDCV", struct.pack(">8H2I", 35400, 14600, 8500, 39850, 6550, 2300, 15635, 16450, 10_000_000, 50)),
        ("cLLI", struct.pack(">2I", 10_000_000, 2_000_000)),
        ("hIST", b"\0\1"),
        ("sPLT", b"own\0\x08" + bytes(range(6))),
        ("pHYs", struct.pack(">IIB", 1000, 2000, 1)),
        ("tIME", struct.pack(">H5B", 2026, 1, 2, 3, 4, 5)),
        ("tEXt", b"Comment\0gamma 2.2"),
        ("sRGB", b"\0"),
    ],
)
@pytest.mark.parametrize("pixels", [RGB8, RGB16], ids=["8", "16"])
def test_what_is_about_displays_changes_nothing(
    tmp_path: Path, name: str, body: bytes, pixels: np.ndarray
) -> None:
    photo = read_photo(png(tmp_path / "a.png", pixels, **{name: body}))
    assert np.array_equal(np.rint(photo.pixels * np.iinfo(pixels.dtype).max), pixels)
    assert (photo.alpha, photo.profile, photo.doubt) == (None, "", "")


@pytest.mark.parametrize("apart", [False, True], ids=["first of the film", "picture of its own"])
def test_of_an_animation_the_still_picture_is_read(tmp_path: Path, apart: bool) -> None:
    frames = [Image.fromarray(RGB8), Image.fromarray(255 - RGB8), Image.fromarray(RGB8 // 2)]
    frames[0].save(
        tmp_path / "a.png", save_all=True, append_images=frames[1:], default_image=apart, duration=40
    )
    data = (tmp_path / "a.png").read_bytes()
    assert b"acTL" in data
    assert b"fdAT" in data
    assert np.array_equal(np.rint(read_photo(tmp_path / "a.png").pixels * 255), RGB8)


def test_rows_may_come_in_the_order_of_adam7(tmp_path: Path) -> None:
    # a pixel a pass, by the first two of the seven
    buffer = BytesIO(encode_png(RGB8[:1, :5]))
    whole = buffer.getvalue()
    head = whole[16:28] + b"\1"
    passes = [RGB8[0, [0]], RGB8[0, [4]], RGB8[0, [2]], RGB8[0, [1, 3]]]
    body = zlib.compress(b"".join(b"\0" + part.tobytes() for part in passes))
    data = whole[:8]
    for kind, chunk in ((b"IHDR", head), (b"IDAT", body), (b"IEND", b"")):
        data += struct.pack(">I", len(chunk)) + kind + chunk + struct.pack(">I", zlib.crc32(kind + chunk))
    (tmp_path / "a.png").write_bytes(data)
    assert np.array_equal(np.rint(read_photo(tmp_path / "a.png").pixels * 255), RGB8[:1, :5])


def test_exif_counts_before_and_behind_the_pixels(tmp_path: Path) -> None:
    from imaging.files.tiff.exif import encode_exif
    from imaging.sensor.mosaic import FrameMetadata

    exif = encode_exif(FrameMetadata(make="Acme", orientation=6)).removeprefix(b"Exif\0\0")
    before = png(tmp_path / "a.png", RGB8, eXIf=exif)
    plain = encode_png(RGB8)
    chunk = struct.pack(">I", len(exif)) + b"eXIf" + exif + struct.pack(">I", zlib.crc32(b"eXIf" + exif))
    (tmp_path / "b.png").write_bytes(plain[:-12] + chunk + plain[-12:])
    for path in (before, tmp_path / "b.png"):
        metadata = read_metadata(path)
        assert (metadata.make, metadata.orientation) == ("Acme", 6)
