"""HEIF and WebP photographs: pixels, EXIF, colour profile, and damage."""

from datetime import datetime
from io import BytesIO

import colour
import cv2
import imagecodecs
import numpy as np
import pytest
from PIL import Image

from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.files.heif_webp import heif_is_read
from imaging.files.photo import is_photo, read_metadata, read_photo
from imaging.files.tiff.exif import encode_exif
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata

SAID = FrameMetadata(
    make="Acme",
    model="Z1",
    exposure=Exposure(time=0.01, f_number=2.0, iso=100),
    captured_at=datetime(2026, 5, 1, 12, 0, 0),
    focal_length_mm=5.7,
)
KINDS = [
    "webp",
    pytest.param("heic", marks=pytest.mark.skipif(not heif_is_read(), reason="pillow-heif is not installed")),
]


def picture(width=96, height=64) -> np.ndarray:
    cells = np.random.default_rng(0).integers(40, 215, (4, 6, 3)).astype(np.uint8)
    return cv2.resize(cells, (width, height), interpolation=cv2.INTER_CUBIC)


def write(path, kind, pixels, **more):
    if kind == "heic":
        import pillow_heif

        pillow_heif.register_heif_opener()
    buffer = BytesIO()
    Image.fromarray(pixels).save(buffer, "HEIF" if kind == "heic" else "WEBP", quality=95, **more)
    path.write_bytes(buffer.getvalue())
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_pixels_and_exif(tmp_path, kind):
    path = write(tmp_path / f"a.{kind}", kind, picture(), exif=encode_exif(SAID))
    assert is_photo(path)
    photo = read_photo(path)
    assert (photo.bit_depth, photo.pixels.shape, photo.profile) == (8, (64, 96, 3), "")
    assert np.abs(photo.pixels - picture() / 255).mean() < 0.01
    for metadata in (photo.metadata, read_metadata(path)):
        assert (metadata.make, metadata.exposure, metadata.captured_at) == (
            "Acme",
            SAID.exposure,
            SAID.captured_at,
        )
        assert metadata.focal_length_mm == pytest.approx(5.7)
    result = import_photos(tmp_path, tmp_path.parent / f"{tmp_path.name}-s")
    assert (result.cameras, result.shots) == (1, 1)


@pytest.mark.parametrize("kind", KINDS)
def test_another_colour_space_becomes_srgb(tmp_path, kind):
    primaries = [0.680, 0.320, 0.265, 0.690, 0.150, 0.060]
    p3 = bytes(imagecodecs.cms_profile("rgb", whitepoint=[0.3127, 0.3290], primaries=primaries, gamma=2.2))
    pixels = np.full((64, 96, 3), (150, 90, 90), np.uint8)
    photo = read_photo(write(tmp_path / f"a.{kind}", kind, pixels, icc_profile=p3))
    assert photo.profile
    red, green, _ = photo.pixels.mean((0, 1)) * 255
    assert red > 153
    assert green < 89


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_cut_off_is_refused(tmp_path, kind):
    path = write(tmp_path / f"a.{kind}", kind, picture())
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(InputError, match=f"a.{kind} is damaged or cut off"):
        read_photo(path)


def numbered(path, primaries, transfer, pixels):
    """A HEIC file of 10 bits whose colour is told by numbers of ITU-T H.273."""
    import pillow_heif

    codes = (pixels.astype(np.uint16) << 8).tobytes()
    size = pixels.shape[1], pixels.shape[0]
    image = pillow_heif.from_bytes(mode="RGB;16", size=size, data=codes)
    image.save(
        path,
        quality=95,
        save_nclx_profile=True,
        color_primaries=primaries,
        transfer_characteristics=transfer,
        matrix_coefficients=9,
        full_range_flag=1,
    )
    return path


@pytest.mark.skipif(not heif_is_read(), reason="pillow-heif is not installed")
@pytest.mark.parametrize("profile", [False, True])
@pytest.mark.parametrize(("transfer", "name"), [(16, "PQ"), (18, "HLG")])
def test_hdr_of_ten_bits_is_refused_by_its_curve(tmp_path, monkeypatch, transfer, name, profile):
    import pillow_heif

    path = numbered(tmp_path / "a.heic", 9, transfer, picture())
    opened = pillow_heif.open_heif

    def with_a_profile_beside(*args, **more):  # which pillow-heif does not write
        image = opened(*args, **more)
        if image.info["nclx_profile"]["transfer_characteristics"] == transfer:
            image.info["icc_profile"] = bytes(imagecodecs.cms_profile("srgb"))
        return image

    if profile:
        monkeypatch.setattr(pillow_heif, "open_heif", with_a_profile_beside)
    with pytest.raises(InputError, match=rf"a\.heic is HDR coded by {name}, as its nclx colour says"):
        read_photo(path)
    write(tmp_path / "b.heic", "heic", picture())
    result = import_photos(tmp_path, tmp_path.parent / f"{tmp_path.name}-s")
    assert result.shots == 1
    assert any(f"HDR coded by {name}" in said for said in (*result.guesses, *result.missing))


@pytest.mark.skipif(not heif_is_read(), reason="pillow-heif is not installed")
def test_numbers_without_a_profile_are_the_light_that_they_mean(tmp_path):
    flat = np.full((64, 96, 3), (150, 90, 90), np.uint8)
    photo = read_photo(numbered(tmp_path / "a.heic", 12, 13, flat))
    assert photo.profile == "Display P3 with curve 13 of their nclx colour"
    light = colour.RGB_to_RGB(
        colour.cctf_decoding(flat[0, 0] / 255, "sRGB"), "Display P3", "sRGB", "Bradford"
    )
    np.testing.assert_allclose(photo.pixels.mean((0, 1)), colour.cctf_encoding(light, "sRGB"), atol=0.01)
    plain = read_photo(numbered(tmp_path / "b.heic", 1, 13, flat))
    assert plain.profile == ""
    np.testing.assert_allclose(plain.pixels.mean((0, 1)), flat[0, 0] / 255, atol=0.01)
    with pytest.raises(InputError, match="its nclx colour primaries 9 and curve 9, which rig does not read"):
        read_photo(numbered(tmp_path / "c.heic", 9, 9, flat))


@pytest.mark.parametrize("brands", [b"avif\0\0\0\0mif1miaf", b"mif1\0\0\0\0avifmiaf", b"avis\0\0\0\0msf1"])
def test_avif_is_named(tmp_path, brands):
    path = tmp_path / "a.heic"
    path.write_bytes(len(brands + bytes(8)).to_bytes(4) + b"ftyp" + brands + bytes(40))
    with pytest.raises(InputError, match=r"a\.heic is an AVIF picture, .*: convert it to JPEG or TIFF\.$"):
        read_photo(path)


@pytest.mark.skipif(not heif_is_read(), reason="pillow-heif is not installed")
@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (6, 1), (8, -1)])
def test_a_picture_of_a_telephone_is_laid_back_as_its_sensor_saw_it(
    tmp_path, monkeypatch, orientation, turns
):
    import pillow_heif

    upright = picture(64, 96)
    path = write(tmp_path / "a.heic", "heic", upright)
    opened = pillow_heif.open_heif

    def as_telephones_write(*args, **more):
        image = opened(*args, **more)
        image.info["exif"] = encode_exif(FrameMetadata(orientation=orientation))
        return image

    monkeypatch.setattr(pillow_heif, "open_heif", as_telephones_write)
    photo = read_photo(path)
    assert np.abs(photo.pixels - np.rot90(upright, turns) / 255).mean() < 0.01
    assert photo.metadata.orientation == orientation
