"""Photographs of every kind that cameras and converters write."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.errors import InputError
from imaging.files.photo import encode_jpeg, encode_png, is_photo, read_metadata, read_photo
from imaging.files.tiff.exif import encode_exif
from imaging.sensor.mosaic import FrameMetadata

from .photographs import RGB8, RGB16, codes, pillow, tiff


@pytest.mark.parametrize("pixels", [RGB8, RGB16, RGB8[..., 0], RGB16[..., 0], RGB16[::-1, ::2]])
def test_png_is_exact(tmp_path: Path, pixels: np.ndarray) -> None:
    decoded = codes(tmp_path / "a.png", encode_png(pixels))
    expected = pixels if pixels.ndim == 3 else pixels[..., None].repeat(3, axis=2)
    assert decoded.dtype == pixels.dtype
    assert np.array_equal(decoded, expected)


def test_red_comes_first(tmp_path: Path) -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 0] = 200
    assert np.array_equal(codes(tmp_path / "a.png", pillow(Image.fromarray(red), "PNG")), red)
    assert np.array_equal(codes(tmp_path / "a.tif", pillow(Image.fromarray(red), "TIFF")), red)
    assert np.array_equal(np.asarray(Image.open(BytesIO(encode_png(red)))), red)
    near = codes(tmp_path / "a.jpg", encode_jpeg(red)).astype(int)
    assert np.abs(near - red).max() <= 3


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"photometric": "rgb", "compression": "deflate", "predictor": True},
        {"photometric": "rgb", "compression": "lzw", "tile": (16, 16)},
        {"photometric": "rgb", "planarconfig": "separate"},
        {"photometric": "rgb", "byteorder": ">"},
        {"photometric": "rgb", "bigtiff": True},
        {"photometric": "rgb", "rowsperstrip": 4},
    ],
    ids=["plain", "deflate", "tiled", "planes", "big-endian", "bigtiff", "strips"],
)
@pytest.mark.parametrize("pixels", [RGB8, RGB16], ids=["8", "16"])
def test_tiff_is_exact(tmp_path: Path, pixels: np.ndarray, options: dict[str, object]) -> None:
    if options.get("planarconfig") == "separate":
        data = tiff(np.moveaxis(pixels, -1, 0), **options)
    else:
        data = tiff(pixels, **{"photometric": "rgb", **options})
    assert np.array_equal(codes(tmp_path / "a.tif", data), pixels)


def test_tiff_grey_and_inverted(tmp_path: Path) -> None:
    grey = RGB16[..., 0]
    three = grey[..., None].repeat(3, axis=2)
    assert np.array_equal(codes(tmp_path / "a.tif", tiff(grey, photometric="minisblack")), three)
    assert np.array_equal(codes(tmp_path / "a.tif", tiff(65535 - grey, photometric="miniswhite")), three)


def test_the_first_page_is_read(tmp_path: Path) -> None:
    buffer = BytesIO()
    with tifffile.TiffWriter(buffer) as file:
        for page in (RGB16, RGB16 // 2):
            file.write(page, photometric="rgb")
    assert np.array_equal(codes(tmp_path / "a.tif", buffer.getvalue()), RGB16)
    stack = pillow(Image.fromarray(RGB8), "TIFF", save_all=True, append_images=[Image.fromarray(RGB8 // 2)])
    assert np.array_equal(codes(tmp_path / "a.tif", stack), RGB8)


@pytest.mark.parametrize("pixels", [RGB8, RGB16])
def test_what_is_transparent_stands_before_black(tmp_path: Path, pixels: np.ndarray) -> None:
    top = np.iinfo(pixels.dtype).max
    alpha = np.full(pixels.shape[:2], top, pixels.dtype)
    alpha[3:9], alpha[9:12] = 0, top // 3
    both = np.dstack([pixels, alpha])
    # alpha is a share of light (PNG specification, 12.16)
    light = srgb_decode(pixels / top) * (alpha / top)[..., None]
    expected = np.where(alpha[..., None] == top, pixels / top, srgb_encode(light))
    grey = both[..., [0, 3]]
    for data, colours in (
        (encode_png(both), expected),
        (tiff(both, photometric="rgb", extrasamples=["unassalpha"]), expected),
        (tiff(grey, photometric="minisblack", extrasamples=["unassalpha"]), expected[..., :1]),
    ):
        (tmp_path / "a").write_bytes(data)
        photo = read_photo(tmp_path / "a")
        assert np.abs(photo.pixels - colours).max() < 1e-6
        assert photo.transparent == pytest.approx(9 / 21)
        np.testing.assert_allclose(photo.alpha, alpha / top, rtol=1e-6)
    # colours that are multiplied by alpha already, to within their rounding
    times = np.dstack([np.rint(pixels * (alpha / top)[..., None]).astype(pixels.dtype), alpha])
    (tmp_path / "a").write_bytes(tiff(times, photometric="rgb", extrasamples=["assocalpha"]))
    assert np.abs(read_photo(tmp_path / "a").pixels - expected).max() < 3 / top


def test_what_is_not_transparent_is_as_without_alpha(tmp_path: Path) -> None:
    opaque = np.dstack([RGB8, np.full(RGB8.shape[:2], 255, np.uint8)])
    (tmp_path / "a.png").write_bytes(encode_png(opaque))
    assert np.array_equal(codes(tmp_path / "a.png", encode_png(opaque)), RGB8)
    assert read_photo(tmp_path / "a.png").transparent == 0
    assert read_photo(tmp_path / "a.png").alpha is None
    # a fourth sample that is not said to be alpha
    unknown = tiff(np.dstack([RGB8, RGB8[..., 0]]), photometric="rgb", extrasamples=["unspecified"])
    assert np.array_equal(codes(tmp_path / "a.tif", unknown), RGB8)
    grey = Image.fromarray(RGB8).convert("LA")
    assert np.array_equal(
        codes(tmp_path / "a.png", pillow(grey, "PNG"))[..., 0], np.asarray(grey.convert("L"))
    )


def test_palettes(tmp_path: Path) -> None:
    palette = Image.fromarray(RGB8).quantize(16)
    assert np.array_equal(
        codes(tmp_path / "a.png", pillow(palette, "PNG")), np.asarray(palette.convert("RGB"))
    )


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_adobe_deflate", "jpeg"])
def test_luma_and_chroma_of_a_tiff_become_colour(tmp_path: Path, compression: str | None) -> None:
    rows, columns = np.mgrid[0:24, 0:40]
    smooth = np.dstack([200 - columns, 60 + rows, 30 + columns + rows]).astype(np.uint8)
    image = Image.fromarray(smooth).convert("YCbCr")
    options = {"quality": 100} if compression == "jpeg" else {}
    decoded = codes(tmp_path / "a.tif", pillow(image, "TIFF", compression=compression, **options)).astype(int)
    # as Pillow converts it, both with their rounding
    assert np.abs(decoded - np.asarray(image.convert("RGB")).astype(int)).max() <= (
        1 if compression != "jpeg" else 4
    )
    assert np.abs(decoded - smooth).max() <= 4


def test_subsampled_chroma_without_jpeg_is_refused(tmp_path: Path) -> None:
    data = pillow(Image.fromarray(RGB8).convert("YCbCr"), "TIFF")
    whole = bytes.fromhex("120203000200000001000100")  # YCbCrSubSampling, SHORT[2]
    assert data.count(whole) == 1
    (tmp_path / "a.tif").write_bytes(data.replace(whole, whole[:8] + bytes.fromhex("02000200")))
    with pytest.raises(InputError, match="is a TIFF of subsampled YCbCr without JPEG: convert it to RGB"):
        read_photo(tmp_path / "a.tif")


def test_jpeg_is_near_and_as_pillow_decodes_it(tmp_path: Path) -> None:
    rows, columns = np.mgrid[0:48, 0:64]
    smooth = np.stack([rows * 5, columns * 4, 255 - rows - columns], axis=-1).astype(np.uint8)
    for data in (
        encode_jpeg(smooth),
        pillow(Image.fromarray(smooth), "JPEG", progressive=True, quality=90),
        pillow(Image.fromarray(smooth), "JPEG", restart_marker_blocks=2),
    ):
        decoded = codes(tmp_path / "a.jpg", data)
        assert np.array_equal(decoded, np.asarray(Image.open(BytesIO(data))))
        assert np.abs(decoded.astype(int) - smooth).mean() < 3
    grey = codes(tmp_path / "a.jpg", encode_jpeg(smooth[..., 0]))
    assert np.array_equal(grey[..., 0], grey[..., 2])


def test_colour_keeps_its_resolution(tmp_path: Path) -> None:
    stripes = np.zeros((16, 16, 3), np.uint8)
    stripes[:, ::2, 0] = stripes[:, 1::2, 2] = 180
    near = codes(tmp_path / "a.jpg", encode_jpeg(stripes, 98)).astype(int)
    assert np.abs(near - stripes).max() < 25
    assert len(encode_jpeg(RGB8, 50)) < len(encode_jpeg(RGB8, 95))


def test_the_content_counts_and_not_the_suffix(tmp_path: Path) -> None:
    assert np.array_equal(codes(tmp_path / "a.jpg", encode_png(RGB8)), RGB8)


def test_a_thumbnail_is_not_the_image(tmp_path: Path) -> None:
    # an EXIF block with a JPEG in it has an end marker of its own
    inner = encode_exif(FrameMetadata(make="M")) + encode_jpeg(RGB8[:8, :8])
    data = pillow(Image.fromarray(RGB8), "JPEG", exif=inner)
    assert codes(tmp_path / "a.jpg", data).shape == RGB8.shape
    (tmp_path / "a.jpg").write_bytes(data[: len(data) // 2 + len(inner) // 2])
    with pytest.raises(InputError, match="damaged or cut off"):
        read_photo(tmp_path / "a.jpg")


def test_suffixes() -> None:
    assert is_photo(Path("a/B.JPG"))
    assert is_photo(Path("a.tiff"))
    assert not is_photo(Path("a.dng"))
    assert not is_photo(Path("a.exr"))


def test_real_brackets_and_castles(rig_data: Path) -> None:
    times = [read_metadata(rig_data / "t2i" / f"stack_room_exp_{i}.jpg").exposure for i in range(7)]
    assert [exposure.time for exposure in times if exposure] == [
        2.0,
        0.5,
        1 / 8,
        1 / 30,
        1 / 125,
        1 / 1000,
        1 / 4000,
    ]
    castle = read_photo(rig_data / "sceaux" / "100_7100.JPG")
    assert castle.pixels.shape == (2128, 2832, 3)
    assert castle.metadata.focal_length_mm == pytest.approx(5.85)
