"""Files of `imaging.files.tiff.dng` in other programs' readers."""

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import rawpy
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging.errors import StorageError
from imaging.files import store
from imaging.files.raw import read_raw
from imaging.files.tiff import dng, dng_tags
from imaging.files.tiff.directory import TiffReader
from imaging.files.tiff.dng import encode_dng, write_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import BAYER, Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic

from ..exiftool import exiftool, needs_exiftool

MakeRaw = Callable[..., RawMosaic]

needs_dcraw = pytest.mark.skipif(shutil.which("dcraw") is None, reason="dcraw is not installed")
both_compressions = pytest.mark.parametrize("compression", ["none", "ljpeg"])


@both_compressions
@pytest.mark.parametrize("cfa", BAYER)
def test_everything_comes_back_as_written(
    tmp_path: Path, make_raw: MakeRaw, cfa: Cfa, compression: str
) -> None:
    raw = make_raw(cfa=cfa)
    write_dng(tmp_path / "a.dng", raw, compression=compression)
    back = read_raw(tmp_path / "a.dng")
    assert np.array_equal(back.pixels, raw.pixels)
    assert back.pixels.dtype == np.uint16
    assert replace(back, pixels=raw.pixels) == raw


@both_compressions
@pytest.mark.parametrize(
    ("height", "width"),
    [(22, 22), (23, 25), (22, 200), (200, 23), (31, 45), (255, 257), (256, 256), (300, 259), (33, 600)],
)
def test_any_size_is_pixel_exact(
    tmp_path: Path, make_raw: MakeRaw, height: int, width: int, compression: str
) -> None:
    raw = make_raw(height, width)
    write_dng(tmp_path / "a.dng", raw, compression=compression)
    assert np.array_equal(read_raw(tmp_path / "a.dng").pixels, raw.pixels)
    assert np.array_equal(tifffile.imread(tmp_path / "a.dng"), raw.pixels)


@both_compressions
@pytest.mark.parametrize("white", [4095, 16383, 65535])
@pytest.mark.parametrize("cfa", BAYER)
@needs_dcraw
def test_dcraw_reads_the_same_pixels(
    tmp_path: Path, make_raw: MakeRaw, cfa: Cfa, white: int, compression: str
) -> None:
    raw = make_raw(53, 301, cfa=cfa, white=white)
    write_dng(tmp_path / "a.dng", raw, compression=compression)
    done = subprocess.run(
        ["dcraw", "-D", "-4", "-T", "-t", "0", "-c", str(tmp_path / "a.dng")],
        capture_output=True,
        check=True,
        timeout=60,
    )
    assert np.array_equal(tifffile.imread(BytesIO(done.stdout)), raw.pixels)
    output = subprocess.run(
        ["dcraw", "-i", "-v", str(tmp_path / "a.dng")], capture_output=True, check=True, timeout=60, text=True
    ).stdout
    assert f"Filter pattern: {cfa}" in output
    assert "Shutter: 1/8000.0 sec" in output
    assert "ISO speed: 200" in output
    assert "Aperture: f/2.8" in output


@both_compressions
def test_libraw_sees_levels_phase_and_exposure(tmp_path: Path, make_raw: MakeRaw, compression: str) -> None:
    raw = make_raw(cfa=Cfa.BGGR, white=16383, black=((512.0, 513.0), (514.0, 515.0)))
    write_dng(tmp_path / "a.dng", raw, compression=compression)
    with rawpy.imread(str(tmp_path / "a.dng")) as opened:
        assert np.array_equal(opened.raw_image, raw.pixels)
        assert np.array_equal(opened.raw_image_visible, raw.pixels)
        letters = opened.color_desc.decode()
        assert [letters[site] for site in opened.raw_pattern.reshape(-1)] == list("BGGR")
        levels = [opened.black_level_per_channel[site] for site in opened.raw_pattern.reshape(-1)]
        assert levels == [512, 513, 514, 515]
        assert opened.white_level == 16383
        assert opened.camera_whitebalance[:3] == pytest.approx([2.0, 1.0, 4 / 3], rel=1e-6)
        assert opened.other.shutter_speed == pytest.approx(1 / 8000, rel=1e-6)
        assert opened.other.iso_speed == 200
        assert opened.other.aperture == pytest.approx(2.8)


@both_compressions
@needs_exiftool
def test_exiftool_finds_nothing_to_warn_about(tmp_path: Path, make_raw: MakeRaw, compression: str) -> None:
    path = tmp_path / "a.dng"
    write_dng(path, make_raw(300, 259), compression=compression)
    tags = exiftool(path, "-n", "-a", "-validate", "-warning", "-error")
    assert tags["Validate"] == "0 0 0"
    assert not {"Warning", "Error"} & tags.keys()


@needs_exiftool
def test_exiftool_reads_every_tag_as_meant(tmp_path: Path, make_raw: MakeRaw) -> None:
    raw = make_raw(cfa=Cfa.GRBG)
    write_dng(tmp_path / "a.dng", raw)
    tags = exiftool(tmp_path / "a.dng", "-n", "-G1")
    expected = {
        "IFD0:Make": "Maker",
        "IFD0:Model": "Model 1",
        "IFD0:Orientation": 6,
        "IFD0:DNGVersion": "1 4 0 0",
        "IFD0:UniqueCameraModel": "Maker Model 1",
        "IFD0:CameraSerialNumber": "S-1",
        "IFD0:CFAPattern2": "1 0 2 1",
        "IFD0:BlackLevel": "255.5 256 257 258.25",
        "IFD0:WhiteLevel": 4000,
        "IFD0:AsShotNeutral": "0.5 1 0.75",
        "IFD0:ColorMatrix1": "0.9 -0.3 -0.1 -0.4 1.2 0.2 0 0.2 0.6",
        "IFD0:CalibrationIlluminant1": 21,
        "IFD0:NoiseProfile": "0.000125 3e-07",
        "IFD0:ActiveArea": "0 0 40 64",
        "IFD0:DefaultCropSize": "64 40",
        "ExifIFD:ExposureTime": 0.000125,
        "ExifIFD:FNumber": 2.8,
        "ExifIFD:ISO": 200,
        "ExifIFD:FocalLength": 35,
        "ExifIFD:FocalLengthIn35mmFormat": 50,
        "ExifIFD:SerialNumber": "S-1",
        "ExifIFD:DateTimeOriginal": "2024:05:06 07:08:09",
        "ExifIFD:SubSecTimeOriginal": 123456,
    }
    assert {name: tags.get(name) for name in expected} == expected


@both_compressions
def test_strips_and_tiles_are_never_both_there(make_raw: MakeRaw, compression: str) -> None:
    (directory,) = TiffReader(BytesIO(encode_dng(make_raw(), compression))).directories()
    strips = {dng_tags.STRIP_OFFSETS, dng_tags.STRIP_SIZES, dng_tags.ROWS_PER_STRIP}
    tiles = {dng_tags.TILE_OFFSETS, dng_tags.TILE_SIZES, dng_tags.TILE_WIDTH, dng_tags.TILE_HEIGHT}
    wanted, other = (tiles, strips) if compression == "ljpeg" else (strips, tiles)
    assert wanted <= directory.keys()
    assert not other & directory.keys()


def test_tags_ascend_and_values_are_aligned(make_raw: MakeRaw) -> None:
    data = encode_dng(make_raw())
    count = int.from_bytes(data[8:10], "little")
    rows = [data[10 + 12 * i : 22 + 12 * i] for i in range(count)]
    tags = [int.from_bytes(row[:2], "little") for row in rows]
    assert tags == sorted(set(tags))
    sizes = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 10: 8, 12: 8}
    for row in rows:
        kind, number = int.from_bytes(row[2:4], "little"), int.from_bytes(row[4:8], "little")
        if sizes[kind] * number > 4:
            assert int.from_bytes(row[8:12], "little") % 2 == 0


@settings(max_examples=60)
@given(
    st.one_of(
        st.sampled_from([1 / 8000, 30.0, 1e-5, 1 / 3, 0.0123456789, 1 / 31.7, 3600.0]),
        st.floats(1e-5, 1e5, allow_nan=False),
    )
)
def test_the_exposure_time_survives(tmp_path_factory: pytest.TempPathFactory, time: float) -> None:
    path = tmp_path_factory.mktemp("dng") / "a.dng"
    raw = RawMosaic(
        np.zeros((22, 22), np.uint16),
        Cfa.RGGB,
        ((0.0,),),
        1023,
        metadata=FrameMetadata(exposure=Exposure(time=time)),
    )
    write_dng(path, raw)
    exposure = read_raw(path).metadata.exposure
    assert exposure is not None
    assert exposure.time == pytest.approx(time, rel=1e-9)
    assert (exposure.f_number, exposure.iso) == (None, None)


@pytest.mark.parametrize("time", [1 / 8000, 30.0, 1e-5, 0.5, 1 / 30, 1 / 60])
def test_customary_times_are_exact(tmp_path: Path, make_raw: MakeRaw, time: float) -> None:
    write_dng(tmp_path / "a.dng", make_raw(metadata=FrameMetadata(exposure=Exposure(time=time))))
    exposure = read_raw(tmp_path / "a.dng").metadata.exposure
    assert exposure is not None
    assert exposure.time == time


def test_a_high_iso_survives(tmp_path: Path, make_raw: MakeRaw) -> None:
    high = FrameMetadata(exposure=Exposure(time=1.0, iso=204800.0))
    write_dng(tmp_path / "a.dng", make_raw(metadata=high))
    assert read_raw(tmp_path / "a.dng").metadata.exposure == high.exposure


def test_names_that_are_not_ascii_survive(tmp_path: Path, make_raw: MakeRaw) -> None:
    named = FrameMetadata(make="Fabrik Süd", model="カメラ", serial="Ø-7")
    write_dng(tmp_path / "a.dng", make_raw(metadata=named))
    assert read_raw(tmp_path / "a.dng").metadata == named


def test_what_is_unknown_stays_unknown(tmp_path: Path, make_raw: MakeRaw) -> None:
    raw = make_raw(neutral=None, camera_from_xyz=None, noise_profile=None, metadata=FrameMetadata())
    write_dng(tmp_path / "a.dng", raw)
    back = read_raw(tmp_path / "a.dng")
    assert replace(back, pixels=raw.pixels) == raw


@both_compressions
@pytest.mark.parametrize(
    ("make", "model"),
    [
        ("Canon", "Canon EOS R6"),
        ("NIKON CORPORATION", "NIKON Z 6"),
        ("SONY", "ILCE-7M4"),
        ("FUJIFILM", "X-T4"),
        ("Panasonic", "DC-S1"),
        ("Hasselblad", "X1D"),
        ("Kodak", "DCS"),
        ("Apple", "iPhone 15 Pro"),
    ],
)
def test_no_maker_makes_a_difference(
    tmp_path: Path, make_raw: MakeRaw, make: str, model: str, compression: str
) -> None:
    raw = make_raw(96, 128, metadata=FrameMetadata(make=make, model=model))
    write_dng(tmp_path / "a.dng", raw, compression=compression)
    back = read_raw(tmp_path / "a.dng")
    assert np.array_equal(back.pixels, raw.pixels)
    assert replace(back, pixels=raw.pixels) == raw


@both_compressions
def test_the_same_mosaic_gives_the_same_bytes(make_raw: MakeRaw, compression: str) -> None:
    assert encode_dng(make_raw(), compression) == encode_dng(make_raw(), compression)


def test_lossless_jpeg_is_smaller_on_an_image(make_raw: MakeRaw) -> None:
    rows, columns = np.mgrid[0:256, 0:384]
    smooth = 2000 + 1000 * np.sin(rows / 50) * np.cos(columns / 70)
    noise = np.random.default_rng(5).normal(0, 8, smooth.shape)
    gains = np.tile([[1.0, 0.5], [0.5, 0.25]], (128, 192))
    pixels = np.clip(smooth * gains + noise, 0, 4000).astype(np.uint16)
    raw = make_raw(pixels=pixels)
    assert len(encode_dng(raw, "ljpeg")) < 0.55 * len(encode_dng(raw, "none"))


def test_strided_pixels_are_written_as_they_look(tmp_path: Path, make_raw: MakeRaw) -> None:
    wide = make_raw(40, 128).pixels
    for compression in ("none", "ljpeg"):
        write_dng(tmp_path / "a.dng", make_raw(pixels=wide[:, ::2]), compression=compression)
        assert np.array_equal(read_raw(tmp_path / "a.dng").pixels, wide[:, ::2])


@pytest.mark.parametrize(
    "wrong",
    [
        {"pixels": np.zeros((40, 40), np.float32)},
        {"pixels": np.zeros((0, 4), np.uint16)},
        {"pixels": np.zeros((40, 21), np.uint16)},
        {"pixels": np.zeros((40, 40, 3), np.uint16)},
        {"black_offset": np.zeros((40, 64), np.float32)},
        {"white": 0},
        {"white": 65536},
        {"black": ((0.0, 0.0), (0.0, 4000.0))},
        {"black": ((-1.0,),)},
        {"black": ((float("nan"),),)},
        {"neutral": (float("inf"), 1.0, 1.0)},
        {"neutral": (-1.0, 1.0, 1.0)},
        {"metadata": FrameMetadata(exposure=Exposure(time=1e-12))},
        {"metadata": FrameMetadata(exposure=Exposure(time=1e12))},
    ],
)
def test_a_mosaic_that_cannot_be_is_refused(make_raw: MakeRaw, wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"."):
        encode_dng(replace(make_raw(), **wrong))


def test_a_refusing_disk_leaves_nothing(
    tmp_path: Path, make_raw: MakeRaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store, "sync", refuse)
    with pytest.raises(StorageError, match="no space left"):
        write_dng(tmp_path / "a.dng", make_raw())
    assert list(tmp_path.iterdir()) == []


def test_the_tile_side_divides_with_little_to_spare() -> None:
    for length in range(22, 2000):
        side = dng._tile_side(length)
        assert side % 16 == 0
        assert 16 <= side <= min(length, 256)
