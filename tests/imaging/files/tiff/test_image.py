"""TIFF images whose tags say something else than the plain case: which page, which samples, which scale."""

from io import BytesIO
from pathlib import Path

import colour
import numpy as np
import pytest
import tifffile

from imaging.colour.spaces import srgb_decode
from imaging.errors import InputError
from imaging.files.photo import read_metadata, read_photo
from tests.imaging.files.tags.test_icc import profile

RGB8 = np.random.default_rng(7).integers(0, 256, (24, 30, 3), dtype=np.uint8)
SMALL = np.zeros((8, 10, 3), np.uint8)


def tiff(*pages: tuple[np.ndarray, dict[str, object]], bigtiff: bool = False) -> bytes:
    buffer = BytesIO()
    with tifffile.TiffWriter(buffer, bigtiff=bigtiff) as file:
        for pixels, options in pages:
            file.write(pixels, **{"photometric": "rgb", "metadata": None, **options})
    return buffer.getvalue()


def codes(path: Path, data: bytes) -> np.ndarray:
    path.write_bytes(data)
    photo = read_photo(path)
    return np.rint(photo.pixels * (255 if photo.bit_depth == 8 else 65535)).astype(int)


@pytest.mark.parametrize("bigtiff", [False, True])
@pytest.mark.parametrize(
    "pages",
    [
        [(SMALL, {"subfiletype": 1}), (RGB8, {})],
        [(SMALL, {"subfiletype": 1}), (SMALL, {"subfiletype": 1}), (RGB8, {"subfiletype": 0})],
        [(SMALL, {"extratags": [(255, 3, 1, 2, True)]}), (RGB8, {"extratags": [(255, 3, 1, 1, True)]})],
        [(SMALL[..., 0] > 0, {"subfiletype": 4, "photometric": "minisblack"}), (RGB8, {})],
        [(RGB8, {}), (SMALL, {"subfiletype": 1})],
        [(RGB8, {"subfiletype": 2}), (RGB8 // 2, {"subfiletype": 2})],
        [(SMALL, {"subfiletype": 1, "subifds": 1}), (RGB8, {"subfiletype": 0})],
        [(RGB8, {"subfiletype": 1})],
    ],
    ids=["one", "two", "old tag", "mask", "behind", "pages", "below", "alone"],
)
def test_the_photograph_is_the_page_that_is_no_thumbnail_and_no_mask(
    tmp_path: Path, pages: list[tuple[np.ndarray, dict[str, object]]], bigtiff: bool
) -> None:
    assert np.array_equal(codes(tmp_path / "a.tif", tiff(*pages, bigtiff=bigtiff)), RGB8)


@pytest.mark.parametrize("bigtiff", [False, True])
def test_the_tags_are_those_of_the_photograph(tmp_path: Path, bigtiff: bool) -> None:
    def tags(make: str, turned: int) -> dict[str, object]:
        return {"extratags": [(271, 2, 0, make, True), (274, 3, 1, turned, True)]}

    data = tiff(
        (SMALL, {"subfiletype": 1, **tags("Thumb", 3)}), (RGB8, {**tags("Maker", 6)}), bigtiff=bigtiff
    )
    (tmp_path / "a.tif").write_bytes(data)
    for metadata in (read_metadata(tmp_path / "a.tif"), read_photo(tmp_path / "a.tif").metadata):
        assert (metadata.make, metadata.orientation) == ("Maker", 6)


def test_bits_may_be_in_reverse(tmp_path: Path) -> None:
    data = bytearray(tiff((RGB8, {})))
    unit = bytes.fromhex("2801030001000000")  # ResolutionUnit, whose place FillOrder takes
    assert data.count(unit) == 1
    place, pixels = data.index(unit), data.index(RGB8.tobytes())
    data[place : place + 12] = bytes.fromhex("0a0103000100000002000000")
    data[pixels : pixels + RGB8.size] = np.packbits(np.unpackbits(RGB8), bitorder="little").tobytes()
    assert np.array_equal(codes(tmp_path / "a.tif", bytes(data)), RGB8)


def test_white_is_zero_of_the_grey_and_not_of_its_alpha(tmp_path: Path) -> None:
    alpha = np.full(RGB8.shape[:2], 255, np.uint8)
    alpha[:6] = 0
    both = np.dstack([255 - RGB8[..., 0], alpha])
    decoded = codes(
        tmp_path / "a.tif", tiff((both, {"photometric": "miniswhite", "extrasamples": ["unassalpha"]}))
    )
    assert np.array_equal(decoded[6:, :, 0], RGB8[6:, :, 0])
    assert not decoded[:6].any()


@pytest.mark.parametrize(
    ("pixels", "options", "named"),
    [
        (RGB8.astype(np.float32), {}, "SampleFormat 3"),
        (RGB8.astype(np.float16), {}, "SampleFormat 3"),
        (RGB8.astype(np.int16), {}, "SampleFormat 2"),
        (
            RGB8[..., 0],
            {"photometric": "minisblack", "extratags": [(291, 3, 256, [7] * 256, True)]},
            "GrayResp",
        ),
        (RGB8, {"extratags": [(532, 5, 6, [16, 1, 235, 1] * 3, True)]}, "ReferenceBlackWhite"),
        (np.stack([RGB8, RGB8]), {"volumetric": True}, "ImageDepth"),
        (RGB8, {"extratags": [(34857, 3, 1, 2, True)]}, "Interlace"),
    ],
    ids=["float", "half", "signed", "densities", "video", "volume", "field"],
)
def test_samples_of_another_meaning_are_refused_by_their_tag(
    tmp_path: Path, pixels: np.ndarray, options: dict[str, object], named: str
) -> None:
    (tmp_path / "a.tif").write_bytes(tiff((pixels, options)))
    with pytest.raises(InputError, match=rf"a\.tif is a TIFF .*{named}.*: convert it .*\.$") as error:
        read_photo(tmp_path / "a.tif")
    assert "\n" not in str(error.value)


def test_levels_that_are_those_of_the_codes_are_no_reason(tmp_path: Path) -> None:
    data = tiff((RGB8, {"extratags": [(532, 5, 6, [0, 1, 255, 1] * 3, True)]}))
    assert np.array_equal(codes(tmp_path / "a.tif", data), RGB8)


@pytest.mark.parametrize(
    "tag",
    [
        (34857, 3, 1, 0, True),  # Interlace: a whole picture
        (34856, 7, 24, bytes(range(24)), True),  # OECF
        (34852, 2, 0, "600 nm", True),  # SpectralSensitivity
        (34858, 8, 1, -5, True),  # TimeZoneOffset
        (37389, 7, 8, bytes(8), True),  # Noise
        (37399, 3, 1, 4, True),  # SensingMethod: three sensors
        (37388, 7, 8, bytes(8), True),  # SpatialFrequencyResponse
        (37397, 5, 1, (800, 1), True),  # ExposureIndex
    ],
)
def test_tags_of_tiff_ep_that_change_no_sample(tmp_path: Path, tag: tuple[object, ...]) -> None:
    assert np.array_equal(codes(tmp_path / "a.tif", tiff((RGB8, {"extratags": [tag]}))), RGB8)


def test_a_profile_of_a_bigtiff_and_of_a_later_page_counts(tmp_path: Path) -> None:
    space = profile("Adobe RGB (1998)")
    expected = codes(tmp_path / "b.tif", tiff((RGB8, {"iccprofile": space})))
    assert np.abs(expected - RGB8).max() > 10
    for data in (
        tiff((RGB8, {"iccprofile": space}), bigtiff=True),
        tiff((SMALL, {"subfiletype": 1}), (RGB8, {"iccprofile": space})),
    ):
        assert np.array_equal(codes(tmp_path / "a.tif", data), expected)


CURVES = {
    "linear": lambda share: share,
    "1.8": lambda share: share**1.8,
    "log": lambda share: 500 ** (share - 1),
}


def table(bits: int, *names: str) -> tuple[int, int, int, list[int], bool]:
    """A TransferFunction of one curve, or of three."""
    share = np.linspace(0, 1, 2**bits)
    values = np.rint(np.concatenate([65535 * CURVES[name](share) for name in names])).astype(int).tolist()
    return (301, 3, len(values), values, True)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("names", [("linear",), ("1.8",), ("log",), ("1.8", "linear", "log")])
def test_a_table_of_light_is_read_where_there_is_no_profile(
    tmp_path: Path, bits: int, names: tuple[str, ...]
) -> None:
    pixels = RGB8 if bits == 8 else RGB8.astype(np.uint16) * 257
    (tmp_path / "a.tif").write_bytes(tiff((pixels, {"extratags": [table(bits, *names)]})))
    photo = read_photo(tmp_path / "a.tif")
    assert photo.profile == "the space of their tag TransferFunction"
    tables = names if len(names) == 3 else names * 3
    light = np.stack([CURVES[name](RGB8[..., c] / 255.0) for c, name in enumerate(tables)], axis=-1)
    np.testing.assert_allclose(srgb_decode(photo.pixels), light, atol=2e-3)
    space = profile("Adobe RGB (1998)")
    data = tiff((pixels, {"extratags": [table(bits, *names)], "iccprofile": space}))
    assert np.array_equal(
        codes(tmp_path / "a.tif", data), codes(tmp_path / "b.tif", tiff((pixels, {"iccprofile": space})))
    )


@pytest.mark.parametrize("inverted", [False, True])
def test_a_table_of_grey_counts_from_the_code_that_is_stored(tmp_path: Path, inverted: bool) -> None:
    values = np.rint(65535 * np.linspace(0, 1, 256) ** 1.8).astype(int)
    values = values[::-1].tolist() if inverted else values.tolist()
    grey = 255 - RGB8[..., 0] if inverted else RGB8[..., 0]
    kind = "miniswhite" if inverted else "minisblack"
    data = tiff((grey, {"photometric": kind, "extratags": [(301, 3, 256, values, True)]}))
    (tmp_path / "a.tif").write_bytes(data)
    decoded = srgb_decode(read_photo(tmp_path / "a.tif").pixels)
    np.testing.assert_allclose(decoded, ((RGB8[..., :1] / 255.0) ** 1.8).repeat(3, 2), atol=2e-3)


def test_primaries_and_white_are_read_where_there_is_no_profile(tmp_path: Path) -> None:
    points = [6800, 3200, 2650, 6900, 1500, 600]
    tags = [(319, 5, 6, [part for value in points for part in (value, 10000)], True)]
    white = (318, 5, 2, [3127, 10000, 3290, 10000], True)
    (tmp_path / "a.tif").write_bytes(tiff((RGB8, {"extratags": [white, *tags]})))
    photo = read_photo(tmp_path / "a.tif")
    light = colour.RGB_to_RGB(srgb_decode(RGB8 / 255.0), "Display P3", "sRGB", "Bradford").clip(0, 1)
    np.testing.assert_allclose(srgb_decode(photo.pixels), light, atol=3e-3)
    assert "PrimaryChromaticities" in photo.profile
    (tmp_path / "a.tif").write_bytes(tiff((RGB8, {"extratags": [white, table(8, "1.8"), *tags]})))
    both = read_photo(tmp_path / "a.tif").pixels
    light = colour.RGB_to_RGB((RGB8 / 255.0) ** 1.8, "Display P3", "sRGB", "Bradford").clip(0, 1)
    np.testing.assert_allclose(srgb_decode(both), light, atol=3e-3)
    ours = [(319, 5, 6, [64, 100, 33, 100, 3, 10, 6, 10, 15, 100, 6, 100], True)]
    assert np.array_equal(codes(tmp_path / "a.tif", tiff((RGB8, {"extratags": [white, *ours]}))), RGB8)


@pytest.mark.parametrize(
    "tags", [[(301, 3, 100, [9] * 100, True)], [table(8, "1.8"), (342, 3, 6, [9] * 6, True)]]
)
def test_a_table_of_other_codes_is_refused(tmp_path: Path, tags: list[object]) -> None:
    (tmp_path / "a.tif").write_bytes(tiff((RGB8, {"extratags": tags})))
    with pytest.raises(
        InputError, match=r"a\.tif has a TransferFunction of other codes .*: convert it to sRGB\.$"
    ):
        read_photo(tmp_path / "a.tif")


def test_what_is_about_printing_changes_nothing(tmp_path: Path) -> None:
    tags = [
        (280, 3, 3, [16] * 3, True),  # MinSampleValue
        (281, 3, 3, [235] * 3, True),  # MaxSampleValue
        (282, 5, 1, [300, 1], True),  # XResolution
        (321, 3, 2, [10, 240], True),  # HalftoneHints
        (336, 1, 6, b"\0\xff" * 3, True),  # DotRange
        (263, 3, 1, 2, True),  # Threshholding
    ]
    for tag in tags:
        assert np.array_equal(codes(tmp_path / "a.tif", tiff((RGB8, {"extratags": [tag]}))), RGB8)
