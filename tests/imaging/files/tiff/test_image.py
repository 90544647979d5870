"""TIFF images whose tags say something else than the plain case: which page, which samples, which scale."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import tifffile

from imaging.errors import InputError
from imaging.files.photo import read_metadata, read_photo
from tests.imaging.files.test_icc import profile

RGB8 = np.random.default_rng(7).integers(0, 256, (24, 30, 3), dtype=np.uint8)
CURVE = (291, 3, 256, [7] * 256, True)
SMALL = np.zeros((8, 10, 3), np.uint8)


def tiff(*pages: tuple[np.ndarray, dict[str, object]], bigtiff: bool = False) -> bytes:
    buffer = BytesIO()
    with tifffile.TiffWriter(buffer, bigtiff=bigtiff) as file:
        for pixels, options in pages:
            file.write(pixels, **{"photometric": "rgb", "metadata": None, **options})
    return buffer.getvalue()


def codes(path: Path, data: bytes) -> np.ndarray:
    path.write_bytes(data)
    seen = read_photo(path)
    return np.rint(seen.pixels * (255 if seen.bit_depth == 8 else 65535)).astype(int)


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
    for seen in (read_metadata(tmp_path / "a.tif"), read_photo(tmp_path / "a.tif").metadata):
        assert (seen.make, seen.orientation) == ("Maker", 6)


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
    seen = codes(
        tmp_path / "a.tif", tiff((both, {"photometric": "miniswhite", "extrasamples": ["unassalpha"]}))
    )
    assert np.array_equal(seen[6:, :, 0], RGB8[6:, :, 0])
    assert not seen[:6].any()


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
    ],
    ids=["float", "half", "signed", "densities", "video", "volume"],
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


def test_a_profile_of_a_bigtiff_and_of_a_later_page_counts(tmp_path: Path) -> None:
    space = profile("Adobe RGB (1998)")
    expected = codes(tmp_path / "b.tif", tiff((RGB8, {"iccprofile": space})))
    assert np.abs(expected - RGB8).max() > 10
    for data in (
        tiff((RGB8, {"iccprofile": space}), bigtiff=True),
        tiff((SMALL, {"subfiletype": 1}), (RGB8, {"iccprofile": space})),
    ):
        assert np.array_equal(codes(tmp_path / "a.tif", data), expected)
