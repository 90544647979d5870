"""Each file format once there and back."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from imaging.cfa import Cfa
from imaging.dng import write_dng
from imaging.exposure import Exposure
from imaging.exr import read_exr, write_exr
from imaging.mosaic import FrameMetadata, RawMosaic
from imaging.photo import encode_jpeg, encode_png, read_metadata, read_photo
from imaging.raw import read_raw

METADATA = FrameMetadata(
    make="Maker",
    model="Model 1",
    serial="S-1",
    exposure=Exposure(time=1 / 8000, f_number=2.8, iso=200),
    captured_at=datetime(2024, 5, 6, 7, 8, 9, 123456),
    focal_length_mm=35.0,
    focal_length_35mm=50.0,
)


@pytest.mark.parametrize("compression", ["none", "ljpeg"])
def test_a_dng_comes_back_as_written(tmp_path: Path, compression: str) -> None:
    pixels = np.random.default_rng(1).integers(0, 4096, (31, 45), dtype=np.uint16)
    raw = RawMosaic(
        pixels,
        Cfa.GBRG,
        (255.5, 256.0, 257.0, 258.25),
        4000,
        (0.5, 1.0, 0.75),
        ((0.9, -0.3, -0.1), (-0.4, 1.2, 0.2), (0.0, 0.2, 0.6)),
        (1.25e-4, 3e-7),
        METADATA,
    )
    write_dng(tmp_path / "a.dng", raw, compression=compression)
    back = read_raw(tmp_path / "a.dng")
    assert np.array_equal(back.pixels, pixels)
    assert replace(back, pixels=pixels) == raw
    assert read_metadata(tmp_path / "a.dng") == METADATA


def test_an_exr_comes_back_as_written(tmp_path: Path) -> None:
    rgb = np.random.default_rng(2).random((9, 7, 3), dtype=np.float32)
    write_exr(tmp_path / "a.exr", rgb, exposure=METADATA.exposure, attributes={"rig:camera": "c0"})
    image = read_exr(tmp_path / "a.exr")
    assert np.array_equal(image.rgb(), rgb)
    assert image.attributes["rig:camera"] == "c0"


def test_photographs_come_back_as_written(tmp_path: Path) -> None:
    codes = np.random.default_rng(3).integers(0, 65536, (9, 7, 3), dtype=np.uint16)
    (tmp_path / "a.png").write_bytes(encode_png(codes))
    photo = read_photo(tmp_path / "a.png")
    assert photo.bit_depth == 16
    assert np.array_equal(np.round(photo.pixels * 65535), codes)
    (tmp_path / "a.jpg").write_bytes(encode_jpeg(np.full((16, 16, 3), (200, 30, 90), np.uint8), 95, METADATA))
    photo = read_photo(tmp_path / "a.jpg")
    assert photo.metadata == METADATA
    assert np.abs(photo.pixels * 255 - (200, 30, 90)).max() <= 2
