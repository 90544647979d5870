"""Metadata of photographs: EXIF written, and read again by rig and by exiftool."""

import json
import shutil
import subprocess
from datetime import datetime, timedelta, timezone
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from imaging.files.jpeg_png import APP1, jpeg_segments
from imaging.files.photo import (
    decode_photo,
    encode_jpeg,
    encode_png,
    read_metadata,
    read_photo,
    read_photo_header,
)
from imaging.files.tiff.exif import encode_exif
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata

from .photographs import RGB8, pillow, tiff


def test_metadata_survives_in_jpeg(tmp_path: Path, metadata: FrameMetadata) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(encode_jpeg(RGB8, metadata=metadata))
    assert read_metadata(path) == metadata
    photo = read_photo(path)
    assert photo.metadata == metadata
    assert photo.pixels.shape == RGB8.shape  # orientation 6 is told and not applied


def test_fill_bytes_before_a_marker_are_stepped_over(tmp_path: Path, metadata: FrameMetadata) -> None:
    """JPEG allows any number of them (T.81, B.1.1.2)."""
    plain = filled = encode_jpeg(RGB8, metadata=metadata)
    for marker, count in ((b"\xff\xe1", 1), (b"\xff\xdb", 2), (b"\xff\xc0", 1), (b"\xff\xda", 3)):
        filled = filled.replace(marker, b"\xff" * count + marker, 1)
    assert len(filled) == len(plain) + 7
    path = tmp_path / "a.jpg"
    path.write_bytes(filled)
    assert np.array_equal(read_photo(path).pixels, decode_photo(plain, "b.jpg").pixels)
    assert read_photo_header(filled, "a.jpg") == (30, 21, metadata)
    assert [*jpeg_segments(BytesIO(filled), APP1)] == [*jpeg_segments(BytesIO(plain), APP1)] != []


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="exiftool is not installed")
def test_exiftool_reads_our_exif(tmp_path: Path, metadata: FrameMetadata) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(encode_jpeg(RGB8, metadata=metadata))
    done = subprocess.run(
        ["exiftool", "-j", "-n", "-validate", "-warning", "-a", "-all", str(path)],
        capture_output=True,
        check=True,
        timeout=60,
    )
    tags = json.loads(done.stdout)[0]
    expected = {
        "Make": "Maker",
        "Model": "Model 1",
        "SerialNumber": "S-1",
        "ExposureTime": 0.000125,
        "FNumber": 2.8,
        "ISO": 200,
        "FocalLength": 35,
        "Orientation": 6,
        "DateTimeOriginal": "2024:05:06 07:08:09",
    }
    assert {name: tags.get(name) for name in expected} == expected
    # the JFIF tags that exiftool misses are not ours to write
    assert "Error" not in tags


@pytest.mark.parametrize("time", [1 / 8000, 1 / 4000, 30.0, 1e-5, 1 / 3])
def test_exposure_times_are_exact(tmp_path: Path, time: float) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(encode_jpeg(RGB8, metadata=FrameMetadata(exposure=Exposure(time=time, iso=100))))
    assert read_metadata(path).exposure == Exposure(time=time, iso=100)


def test_metadata_in_png_and_tiff(tmp_path: Path, metadata: FrameMetadata) -> None:
    block = encode_exif(metadata)
    (tmp_path / "a.png").write_bytes(pillow(Image.fromarray(RGB8), "PNG", exif=block))
    assert read_metadata(tmp_path / "a.png") == metadata
    (tmp_path / "a.tif").write_bytes(pillow(Image.fromarray(RGB8), "TIFF", exif=block))
    assert read_metadata(tmp_path / "a.tif") == metadata
    assert read_photo(tmp_path / "a.tif").metadata == metadata


def test_a_time_zone_is_written_and_the_clock_read(tmp_path: Path) -> None:
    zoned = datetime(2024, 5, 6, 7, 8, 9, tzinfo=timezone(timedelta(hours=-3, minutes=-30)))
    path = tmp_path / "a.jpg"
    path.write_bytes(encode_jpeg(RGB8, metadata=FrameMetadata(captured_at=zoned)))
    assert read_metadata(path).captured_at == datetime(2024, 5, 6, 7, 8, 9)
    with Image.open(path) as image:
        assert image.getexif().get_ifd(0x8769)[36881] == "-03:30"


def test_files_without_metadata_have_none(tmp_path: Path) -> None:
    for name, data in (("a.jpg", encode_jpeg(RGB8)), ("a.png", encode_png(RGB8)), ("a.tif", tiff(RGB8))):
        (tmp_path / name).write_bytes(data)
        assert read_metadata(tmp_path / name).exposure is None
        assert read_metadata(tmp_path / name).make == ""
