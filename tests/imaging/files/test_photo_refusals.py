"""Photographs that are damaged, or of a kind that is not read."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image

from imaging.errors import InputError
from imaging.files.photo import encode_jpeg, encode_png, read_metadata, read_photo
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from tests.imaging.files.damage import damaged

from .photographs import RGB8, RGB16, codes, pillow, tiff

SOUND = {
    "a.jpg": encode_jpeg(RGB8, metadata=FrameMetadata(make="M", exposure=Exposure(time=0.5))),
    "b.jpg": pillow(Image.fromarray(RGB8), "JPEG", progressive=True),
    "a.png": encode_png(RGB16),
    "a.tif": tiff(RGB16, photometric="rgb"),
    "b.tif": tiff(RGB16, photometric="rgb", compression="deflate", rowsperstrip=4),
}


@pytest.mark.parametrize("name", SOUND)
def test_a_file_cut_off_anywhere_is_refused_in_silence(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    data, path = SOUND[name], tmp_path / name
    pixels_end = len(data) - 1
    for end in [*range(0, pixels_end, max(1, len(data) // 60)), pixels_end]:
        path.write_bytes(data[:end])
        with pytest.raises(InputError) as error:
            read_photo(path)
        text = str(error.value)
        assert text.startswith(str(path))
        assert text.endswith(".")
        assert "\n" not in text
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", SOUND)
def test_damaged_bytes_never_raise_anything_else(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    data, path = SOUND[name], tmp_path_factory.mktemp("photo") / name

    @settings(max_examples=150)
    @given(damaged(data, 400))
    def damage(wrong: bytes) -> None:
        path.write_bytes(wrong)
        for read in (read_photo, read_metadata):
            try:
                read(path)
            except InputError:
                continue

    damage()


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.jpg").write_text("I am a text file")
    (tmp_path / "zeros.png").write_bytes(bytes(500))
    (tmp_path / "empty.tif").write_bytes(b"")
    (tmp_path / "folder.jpg").mkdir()
    for name, says in (
        ("text.jpg", "not a JPEG, PNG or TIFF"),
        ("zeros.png", "not a JPEG, PNG or TIFF"),
        ("empty.tif", "is empty"),
        ("folder.jpg", "is a directory"),
        ("missing.jpg", "no such file"),
    ):
        with pytest.raises(InputError, match=says):
            read_photo(tmp_path / name)
        with pytest.raises(InputError, match=r"cannot be read|not a photograph"):
            read_metadata(tmp_path / name)
    (tmp_path / "notes.txt").write_text("I am a text file")
    with pytest.raises(InputError, match="not a photograph"):
        read_metadata(tmp_path / "notes.txt")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("float.tif", tiff(RGB8.astype(np.float32), photometric="rgb")),
        ("deep.tif", tiff(RGB8.astype(np.uint32), photometric="rgb")),
        ("bits.tif", pillow(Image.fromarray(RGB8[..., 0] > 99), "TIFF")),
        ("palette.tif", pillow(Image.fromarray(RGB8).quantize(16), "TIFF")),
        ("cmyk.tif", pillow(Image.fromarray(RGB8).convert("CMYK"), "TIFF")),
        ("cmyk.jpg", pillow(Image.fromarray(RGB8).convert("CMYK"), "JPEG")),
    ],
)
def test_kinds_that_are_not_read_are_named(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=rf"{name} is a (TIFF|JPEG) .*: convert it .*\.$"):
        read_photo(tmp_path / name)


def test_a_header_that_asks_for_too_much_is_refused(tmp_path: Path) -> None:
    data = bytearray(encode_png(RGB8))
    data[16:24] = (100_000).to_bytes(4) * 2
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        read_photo(tmp_path / "a.png")


def test_a_large_image_is_no_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Pillow takes large photographs for bombs
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name, data in SOUND.items():
            assert codes(tmp_path / name, data).shape == RGB8.shape


@pytest.mark.parametrize("encode", [encode_jpeg, encode_png])
def test_only_code_values_are_encoded(encode: object) -> None:
    with pytest.raises(ValueError, match="uint8"):
        encode(np.zeros((4, 4, 3), np.float32))
    with pytest.raises(ValueError, match="uint8"):
        encode_jpeg(RGB16)
