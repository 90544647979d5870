"""PNG's cICP chunk and the curves of grey pictures, against colour-science and the definitions."""

import struct
import zlib
from pathlib import Path

import colour
import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from imaging.errors import InputError
from imaging.files.photo import encode_png, read_photo

RAMP = np.linspace(0, 65535, 257).astype(np.uint16)
RGB = np.random.default_rng(3).integers(0, 65536, (16, 20, 3), dtype=np.uint16)
GREY = np.tile(RAMP, (4, 1))


def png(path: Path, pixels: np.ndarray, **chunks: bytes) -> Path:
    """A PNG with chunks before its pixels."""
    raw = encode_png(pixels)
    extra = b""
    for name, body in chunks.items():
        kind = name.encode()
        extra += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    path.write_bytes(raw[:33] + extra + raw[33:])
    return path


def light(path: Path) -> np.ndarray:
    return colour.cctf_decoding(read_photo(path).pixels.astype(np.float64), "sRGB")


def expected(codes: np.ndarray, space: str, decode: object) -> np.ndarray:
    linear = decode(codes / 65535)
    return np.clip(colour.RGB_to_RGB(linear, space, "sRGB", "Bradford"), 0, 1)


@pytest.mark.parametrize(
    ("body", "space", "decode"),
    [
        ((12, 13, 0, 1), "Display P3", lambda v: colour.cctf_decoding(v, "sRGB")),
        ((1, 8, 0, 1), "sRGB", lambda v: v),
        ((9, 8, 0, 1), "ITU-R BT.2020", lambda v: v),
        ((9, 1, 0, 1), "ITU-R BT.2020", lambda v: colour.models.oetf_inverse_BT709(v)),
        ((9, 14, 0, 1), "ITU-R BT.2020", lambda v: colour.models.oetf_inverse_BT709(v)),
        ((1, 4, 0, 1), "sRGB", lambda v: v**2.2),
        ((2, 8, 0, 1), "sRGB", lambda v: v),
        ((12, 2, 0, 1), "Display P3", lambda v: colour.cctf_decoding(v, "sRGB")),
    ],
)
def test_the_chunk_is_the_light_that_it_means(
    tmp_path: Path, body: tuple[int, ...], space: str, decode: object
) -> None:
    # it counts before all other chunks
    path = png(tmp_path / "a.png", RGB, sRGB=b"\0", gAMA=struct.pack(">I", 30_000), cICP=bytes(body))
    np.testing.assert_allclose(light(path), expected(RGB, space, decode), atol=2e-3)
    assert "cICP" in read_photo(path).profile


def test_srgb_and_nothing_specified_change_nothing(tmp_path: Path) -> None:
    for body in ((1, 13, 0, 1), (2, 2, 0, 1)):
        photo = read_photo(png(tmp_path / "a.png", RGB, cICP=bytes(body)))
        assert photo.profile == ""
        assert np.array_equal(np.rint(photo.pixels * 65535), RGB)


@pytest.mark.parametrize("pixels", [RGB, (RGB >> 8).astype(np.uint8)])
def test_a_narrow_range_has_its_black_and_white_inside(tmp_path: Path, pixels: np.ndarray) -> None:
    step = 256 if pixels.dtype == np.uint16 else 1
    share = np.clip((pixels / step - 16) / 219, 0, 1)
    decoded = read_photo(png(tmp_path / "a.png", pixels, cICP=bytes((1, 13, 0, 0)))).pixels
    np.testing.assert_allclose(decoded, share, atol=2e-3)


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ((9, 16, 0, 1), "is HDR coded by PQ, as its cICP chunk says"),
        ((1, 18, 0, 1), "is HDR coded by HLG, as its cICP chunk says"),
        ((1, 13, 1, 1), "not RGB, as its cICP chunk says"),
        ((1, 9, 0, 1), "curve 9, which rig does not read"),
        ((77, 13, 0, 1), "primaries 77"),
    ],
)
@pytest.mark.parametrize("pixels", [RGB, RGB[..., 0]])
def test_what_is_not_read_is_refused_by_the_chunk(
    tmp_path: Path, body: tuple[int, ...], says: str, pixels: np.ndarray
) -> None:
    path = png(tmp_path / "a.png", pixels, cICP=bytes(body))
    with pytest.raises(InputError, match=says) as error:
        read_photo(path)
    assert str(error.value).startswith(f"{path} ")
    assert str(error.value).endswith(".")


def test_a_profile_that_names_an_hdr_curve_is_refused(tmp_path: Path) -> None:
    space = bytearray(imagecodecs.cms_profile("rgb", gamma=2.2))
    count = int.from_bytes(space[128:132])
    # the copyright, which is not used for colour, becomes `cicp`
    place = 132 + 12 * next(
        n for n in range(count) if space[132 + 12 * n : 136 + 12 * n] in (b"desc", b"cprt")
    )
    at = int.from_bytes(space[place + 4 : place + 8])
    space[place : place + 4] = b"cicp"
    space[at : at + 12] = b"cicp\0\0\0\0\x09\x10\0\x01"
    Image.fromarray((RGB >> 8).astype(np.uint8)).save(tmp_path / "a.jpg", icc_profile=bytes(space))
    with pytest.raises(InputError, match="HDR coded by PQ, as its colour profile says"):
        read_photo(tmp_path / "a.jpg")


@pytest.mark.parametrize("gamma", [1.0, 1.8])
def test_the_curve_of_a_grey_picture_counts(tmp_path: Path, gamma: float) -> None:
    profile = bytes(imagecodecs.cms_profile("gray", gamma=gamma))
    tifffile.imwrite(tmp_path / "a.tif", GREY, photometric="minisblack", iccprofile=profile)
    zipped = png(tmp_path / "a.png", GREY, iCCP=b"own\0\0" + zlib.compress(profile))
    with_gamma = png(tmp_path / "b.png", GREY, gAMA=struct.pack(">I", round(100_000 / gamma)))
    for path in (tmp_path / "a.tif", zipped, with_gamma):
        decoded = light(path)
        np.testing.assert_allclose(decoded[0, :, 0], (RAMP / 65535) ** gamma, atol=1.5e-3)
        assert np.abs(decoded - decoded[..., :1]).max() < 2e-3
        assert read_photo(path).profile
    small = Image.fromarray((GREY >> 8).astype(np.uint8))
    small.save(tmp_path / "a.jpg", quality=100, icc_profile=profile)
    np.testing.assert_allclose(light(tmp_path / "a.jpg")[0, :, 0], (RAMP // 256 / 255) ** gamma, atol=0.02)


def test_alpha_of_a_grey_picture_is_no_code(tmp_path: Path) -> None:
    alpha = np.full(GREY.shape, 65535, np.uint16)
    path = png(
        tmp_path / "a.png", np.dstack([GREY, alpha])[:, :, [0, 0, 0, 1]], gAMA=struct.pack(">I", 100_000)
    )
    np.testing.assert_allclose(light(path)[0, :, 0], RAMP / 65535, atol=1.5e-3)
    assert read_photo(path).alpha is None


def test_primaries_without_a_curve_have_that_of_srgb(tmp_path: Path) -> None:
    points = (0.3127, 0.3290, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06)
    body = b"".join(struct.pack(">I", round(100_000 * value)) for value in points)
    path = png(tmp_path / "a.png", RGB, cHRM=body)
    wanted = expected(RGB, "Display P3", lambda v: colour.cctf_decoding(v, "sRGB"))
    np.testing.assert_allclose(light(path), wanted, atol=3e-3)
    assert "cHRM" in read_photo(path).profile
