"""Photographs in other colour spaces become what they are in sRGB, by littleCMS and by colour-science."""

from io import BytesIO
from pathlib import Path

import colour
import imagecodecs
import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageCms, PngImagePlugin

from imaging.files.photo import read_photo
from imaging.files.tags import icc
from imaging.files.tiff.exif import encode_exif
from imaging.merge.linear_frame import SATURATED_CODE
from imaging.sensor.mosaic import FrameMetadata

D65, D50 = [0.3127, 0.3290], [0.3457, 0.3585]
SPACES = {
    "Display P3": (D65, [0.68, 0.32, 0.265, 0.69, 0.15, 0.06], None),
    "Adobe RGB (1998)": (D65, [0.64, 0.33, 0.21, 0.71, 0.15, 0.06], 563 / 256),
    "ProPhoto RGB": (D50, [0.734699, 0.265301, 0.159597, 0.840403, 0.036598, 0.000105], 1.8),
}
"""White, primaries, and the power of the curve; None: the curve of sRGB."""
CURVE = np.rint(65535 * colour.cctf_decoding(np.linspace(0, 1, 4096), "sRGB")).astype(np.uint16)


def profile(name: str) -> bytes:
    white, primaries, gamma = SPACES[name]
    curve = {"transferfunction": CURVE} if gamma is None else {"gamma": gamma}
    return bytes(imagecodecs.cms_profile("rgb", whitepoint=white, primaries=primaries, **curve))


def patches(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Linear Rec.709 of patches, and the codes of a picture of them in a space."""
    linear = np.random.default_rng(1).uniform(0.05, 0.8, (6, 8, 3))
    in_space = np.clip(colour.RGB_to_RGB(linear, "sRGB", name, "Bradford"), 0, 1)
    gamma = SPACES[name][2]
    codes = colour.cctf_encoding(in_space, "sRGB") if gamma is None else in_space ** (1 / gamma)
    return linear, np.kron(codes, np.ones((8, 8, 1)))


def lab(linear: np.ndarray) -> np.ndarray:
    return colour.XYZ_to_Lab(colour.RGB_to_XYZ(linear, "sRGB", apply_cctf_decoding=False))


def difference(linear: np.ndarray, path: Path) -> np.ndarray:
    """CIEDE2000 of the middle of every patch."""
    decoded = colour.cctf_decoding(read_photo(path).pixels[4::8, 4::8].astype(np.float64), "sRGB")
    return np.asarray(colour.delta_E(lab(linear), lab(decoded), method="CIE 2000"))


def saved(path: Path, codes: np.ndarray, embedded: bytes | None, **options: object) -> Path:
    image = Image.fromarray(np.rint(codes * 255).astype(np.uint8))
    if path.suffix == ".jpg":
        options = {"quality": 100, "subsampling": 0} | options
    image.save(path, **({} if embedded is None else {"icc_profile": embedded}), **options)
    return path


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
@pytest.mark.parametrize("name", SPACES)
def test_a_photograph_with_a_profile_is_the_light_that_it_means(
    tmp_path: Path, name: str, suffix: str
) -> None:
    linear, codes = patches(name)
    path = saved(tmp_path / f"a{suffix}", codes, profile(name))
    assert difference(linear, path).mean() < 0.6  # of 8 bits
    assert difference(linear, path).max() < 1.5
    bare = saved(tmp_path / f"b{suffix}", codes, None)
    assert difference(linear, bare).mean() > 2
    assert read_photo(path).profile
    assert not read_photo(bare).profile


@pytest.mark.parametrize("exact", [icc.EXACT, -1.0])
@pytest.mark.parametrize("name", SPACES)
def test_littlecms_converts_alike(
    name: str, exact: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # by curves and a matrix, or where these are not exact enough by littleCMS itself
    monkeypatch.setattr(icc, "EXACT", exact)
    icc._profile.cache_clear()
    path = saved(tmp_path / "a.png", np.random.default_rng(3).random((40, 50, 3)), profile(name))
    with Image.open(path) as image:
        srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))
        expected = np.asarray(ImageCms.profileToProfile(image, BytesIO(profile(name)), srgb, 1)) / 255
    assert np.abs(read_photo(path).pixels - expected).max() < 2 / 255
    icc._profile.cache_clear()


def test_what_is_clipped_or_black_stays_so(tmp_path: Path) -> None:
    for name in SPACES:
        codes = np.random.default_rng(5).random((30, 30, 3))
        codes[:10, :, 0], codes[10:20, :, 1], codes[25:] = 1.0, 0.0, 1.0
        pixels = read_photo(saved(tmp_path / "a.png", codes, profile(name))).pixels
        assert (pixels[:10, :, 0] >= SATURATED_CODE).all()
        assert (pixels[25:] >= SATURATED_CODE).all()
        assert (pixels[10:20, :, 1] <= 1 / 255).all()


def test_sixteen_bits_keep_their_steps(tmp_path: Path) -> None:
    ramp = np.repeat(np.arange(0, 65536, 16, dtype=np.uint16)[None, :, None], 3, axis=2)
    embedded = profile("ProPhoto RGB")
    tifffile.imwrite(
        tmp_path / "a.tif", ramp, photometric="rgb", extratags=[(34675, 7, len(embedded), embedded, True)]
    )
    pixels = read_photo(tmp_path / "a.tif").pixels[0]
    expected = colour.cctf_encoding((ramp[0] / 65535) ** 1.8, "sRGB")
    assert np.abs(pixels - expected).max() < 1e-3
    assert len(np.unique(pixels[:, 1])) > 3800


def test_srgb_and_what_cannot_be_used_change_nothing(tmp_path: Path) -> None:
    codes = np.random.default_rng(6).random((16, 16, 3))
    plain = read_photo(saved(tmp_path / "a.png", codes, None)).pixels
    for embedded in (
        ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes(),
        bytes(imagecodecs.cms_profile("srgb")),
        profile("Display P3").replace(b"RGB ", b"CMYK", 1),
        profile("Display P3")[:300],
        b"nothing" * 30,
    ):
        photo = read_photo(saved(tmp_path / "b.png", codes, embedded))
        assert photo.profile == ""
        assert np.array_equal(photo.pixels, plain)


def test_exif_tells_adobe_rgb(tmp_path: Path) -> None:
    linear, codes = patches("Adobe RGB (1998)")

    def photo(space: int, rule: str) -> Path:
        exif = Image.Exif()
        exif.get_ifd(0x8769)[40961] = space
        exif.get_ifd(0x8769)[40965] = {1: rule}
        return saved(tmp_path / "a.jpg", codes, None, exif=exif)

    for space, rule in ((65535, "R03"), (2, "R98")):
        path = photo(space, rule)
        assert read_photo(path).profile == "Adobe RGB (1998), as EXIF has it"
        assert difference(linear, path).max() < 1.5
    for space, rule in ((1, "R98"), (1, "R03"), (65535, "R98")):
        assert read_photo(photo(space, rule)).profile == ""
    none = saved(tmp_path / "a.jpg", codes, None, exif=encode_exif(FrameMetadata()))
    assert read_photo(none).profile == ""


def test_chunks_of_a_png_tell_primaries_and_gamma(tmp_path: Path) -> None:
    linear, codes = patches("Adobe RGB (1998)")
    primaries = [*D65, 0.64, 0.33, 0.21, 0.71, 0.15, 0.06]

    def photo(points: list[float], power: float, *, srgb: bool = False) -> Path:
        chunks = PngImagePlugin.PngInfo()
        chunks.add(b"gAMA", round(power * 100_000).to_bytes(4))
        chunks.add(b"cHRM", b"".join(round(value * 100_000).to_bytes(4) for value in points))
        if srgb:
            chunks.add(b"sRGB", b"\0")
        return saved(tmp_path / "a.png", codes, None, pnginfo=chunks)

    path = photo(primaries, 256 / 563)
    assert read_photo(path).profile == "the space of their gAMA and cHRM chunks"
    assert difference(linear, path).max() < 1.5
    assert read_photo(photo(primaries, 256 / 563, srgb=True)).profile == ""
    assert read_photo(photo([*D65, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06], 0.45455)).profile == ""
    for useless in (0.0, 30.0):
        assert read_photo(photo(primaries, useless)).profile == ""
    assert read_photo(photo([0.0] * 8, 0.5)).profile == ""


def test_a_profile_that_inflates_without_end_is_none(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.png", np.full((8, 8, 3), 0.5), bytes(icc.LARGEST + 100))
    assert read_photo(path).profile == ""


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 599), st.integers(0, 255)), min_size=1, max_size=6))
def test_a_damaged_profile_is_used_or_none(changes: list[tuple[int, int]]) -> None:
    damaged = bytearray(profile("Adobe RGB (1998)"))
    for place, value in changes:
        damaged[place % len(damaged)] = value
    buffer = BytesIO()
    Image.fromarray(np.full((4, 4, 3), 90, np.uint8)).save(buffer, "PNG", icc_profile=bytes(damaged))
    parsed = icc.profile_of(buffer.getvalue())
    if parsed is not None:
        pixels = np.full((4, 4, 3), 0.4, np.float32)
        parsed.apply(pixels)
        assert pixels.min() >= 0
        assert pixels.max() <= 1
