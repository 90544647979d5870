"""Pictures that show so little that equal ones are no copies, and those that show enough."""

from pathlib import Path

import imagecodecs
import numpy as np
import pytest

from capture.check.check import check
from capture.imports.photos import import_photos
from capture.pictures.read import is_without_tones
from imaging.files.photo import encode_jpeg, encode_png
from imaging.files.tiff.dng import encode_dng
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from tests.capture.imports.photo_files import put

SIZE = (96, 144)
RNG = np.random.default_rng(0)


def raw(signal: np.ndarray) -> bytes:
    return encode_dng(RawMosaic(np.rint(signal).astype(np.uint16), Cfa.RGGB, ((64.0,),), 4095))


def with_spot(pixels: np.ndarray, value: float, size: int = 1) -> np.ndarray:
    pixels = pixels.copy()
    pixels[40 : 40 + size, 60 : 60 + size] = value
    return pixels


def disc(inside: float, outside: float) -> np.ndarray:
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    return np.where(np.hypot(x - 72, y - 48) < 40, inside, outside)


def grey(pixels: np.ndarray) -> np.ndarray:
    return np.repeat(np.clip(np.rint(pixels), 0, 255).astype(np.uint8)[..., None], 3, axis=-1)


BLACK = np.full(SIZE, 64.0)
READ_NOISE = BLACK + RNG.normal(0, 3, SIZE)
FIELD = np.tile([[300.0, 700.0], [700.0, 450.0]], (SIZE[0] // 2, SIZE[1] // 2))
NIGHT = np.clip(RNG.normal(10, 3, SIZE), 0, 24)
LIGHT = np.repeat(RNG.uniform(0, 1, SIZE).astype(np.float32)[..., None], 3, axis=-1)

WITHOUT = {
    "black.dng": raw(BLACK),
    "black with a hot pixel.dng": raw(with_spot(BLACK, 4095)),
    "flat field.dng": raw(FIELD),
    "white.dng": raw(np.full(SIZE, 4095)),
    "disc.dng": raw(disc(4095, 64)),
    "black with a hot pixel.png": encode_png(grey(with_spot(np.zeros(SIZE), 90))),
    "disc 75.jpg": encode_jpeg(grey(disc(255, 0)), 75),
    "disc 95.jpg": encode_jpeg(grey(disc(255, 0)), 95),
    "black.hdr": bytes(imagecodecs.rgbe_encode(0 * LIGHT)),
}
WITH = {
    "lens cap.dng": raw(READ_NOISE),
    "lens cap with a hot pixel.dng": raw(with_spot(READ_NOISE, 4095)),
    "noisy disc.dng": raw(np.where(disc(1, 0) > 0, 4095, READ_NOISE)),
    "night.jpg": encode_jpeg(grey(with_spot(NIGHT, 250, 4)), 90),
    "window at night.jpg": encode_jpeg(grey(with_spot(NIGHT, 255, 50)), 90),
    "lamp.hdr": bytes(imagecodecs.rgbe_encode(with_spot(LIGHT, 5000, 3))),
    "room.dng": raw(with_spot(np.random.default_rng(1).normal(300, 10, SIZE), 4095, 4)),
}


@pytest.mark.parametrize("name", WITHOUT | WITH)
def test_equal_pictures_may_be_no_copies_where_they_show_little_and_no_noise(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_bytes((WITHOUT | WITH)[name])
    assert is_without_tones(tmp_path / name) is (name in WITHOUT)


@pytest.mark.parametrize("name", WITH)
def test_copies_of_dark_pictures_are_left_out_by_an_import_and_named_by_a_check(
    tmp_path: Path, name: str
) -> None:
    files = {f"a {name}": WITH[name], f"a copy of {name}": WITH[name]}
    assert import_photos(put(tmp_path / "in", files), tmp_path / "s").shots == 1
    assert not check(tmp_path / "s").problems
    apart = put(tmp_path / "apart", {f"{folder}/{name}": WITH[name] for folder in "ab"})
    assert import_photos(apart, tmp_path / "t").shots == 2
    assert [problem.kind for problem in check(tmp_path / "t").problems] == ["duplicate"]
