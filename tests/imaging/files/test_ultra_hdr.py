"""Ultra HDR JPEG, read by libultrahdr, ExifTool and Pillow."""

import io
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.files.hdr_display import HEADROOM
from imaging.files.photo import decode_photo
from imaging.files.radiance_hdr import read_hdr
from imaging.files.ultra_hdr import encode_ultra_hdr
from tests.imaging.files.exiftool import exiftool, needs_exiftool
from tests.imaging.files.test_hdr_display import LUMINANCE, PATCH, patches, stops_off, wall

STRUCK_OUT = {"both": [], "XMP": [b"urn:iso:std:iso:ts:21496:-1"], "ISO": [b"hdrgm"]}
"""Names without which a reader has one statement alone."""


def srgb(light: np.ndarray) -> np.ndarray:
    """Clipped at white, as PNG are."""
    return np.round(255 * srgb_encode(np.clip(light, 0, 1))).astype(np.uint8)


def read(data: bytes, stops: float = HEADROOM) -> np.ndarray:
    """By libultrahdr, linear light [H, W, 3] on a screen of that many stops above white."""
    return np.asarray(imagecodecs.ultrahdr_decode(data, boost=2.0**stops), np.float32)[..., :3]


@pytest.mark.parametrize("said", STRUCK_OUT)
def test_libultrahdr_restores_the_light(said: str) -> None:
    light = wall()
    data = encode_ultra_hdr(light, srgb(light))
    for name in STRUCK_OUT[said]:
        data = data.replace(name, name[::-1])
    shown = read(data)
    assert stops_off(shown, light)[:, 1:].max() < 0.05
    assert np.abs(np.log2(patches(shown)[:, 3:] / patches(light)[:, 3:])).max() < 0.05  # of each channel
    with pytest.raises(RuntimeError):
        read(data.replace(b"urn:iso", b"osi:nru").replace(b"hdrgm", b"mgrdh"))


def test_the_picture_without_the_map_is_the_one_that_was_given() -> None:
    light = wall()
    base = srgb(light / (1 + light))  # of any tones
    data = encode_ultra_hdr(light, base)
    assert np.abs(np.asarray(Image.open(io.BytesIO(data)), int) - base)[PATCH // 2 :: PATCH].max() <= 1
    assert stops_off(read(data), light)[:, 1:].max() < 0.05
    photo = decode_photo(data, "a.jpg")
    assert np.abs(255 * photo.pixels - base)[PATCH // 2 :: PATCH].max() <= 1
    assert "gain map" in photo.doubt


@needs_exiftool
def test_exiftool_reads_the_directory_and_the_formula_of_the_map(tmp_path: Path) -> None:
    """MPF, the directory of GContainer, and the numbers in XMP, by the formula of the standard."""
    light = wall()
    data = encode_ultra_hdr(light, srgb(light))
    (tmp_path / "a.jpg").write_bytes(data)
    said = exiftool(tmp_path / "a.jpg", "-G1", "-struct", "-validate", "-all")
    assert said["ExifTool:Warning"] == "[minor] Unknown APP2 segment"  # of ISO 21496-1
    first, second = (part["Item"] for part in said["XMP-Container:Directory"])
    assert (first["Semantic"], second["Semantic"], second["Mime"]) == ("Primary", "GainMap", "image/jpeg")
    assert said["MPF0:NumberOfImages"] == 2
    start, size = said["MPImage2:MPImageStart"], said["MPImage2:MPImageLength"]
    assert start == said["MPImage1:MPImageLength"]
    assert size == second["Length"] == len(data) - start
    (tmp_path / "b.jpg").write_bytes(data[start:])
    stated = exiftool(tmp_path / "b.jpg")
    assert stated["HDRCapacityMax"] == HEADROOM
    base, codes = (
        np.asarray(Image.open(tmp_path / name).convert("RGB")) / 255 for name in ("a.jpg", "b.jpg")
    )
    gain = stated["GainMapMin"] + (stated["GainMapMax"] - stated["GainMapMin"]) * codes
    shown = (srgb_decode(base) + stated["OffsetSDR"]) * 2.0**gain - stated["OffsetHDR"]
    assert stops_off(shown, light)[:, 1:].max() < 0.03


def test_a_screen_of_less_headroom_shows_a_part(tmp_path: Path) -> None:
    """The gain is weighted by headroom; a picture that is never bright needs none."""
    light = np.full((PATCH, PATCH, 3), 4.0, np.float32)
    bright = encode_ultra_hdr(light, srgb(light))
    for stops in (0.0, 1.0, 2.0, 4.0):
        np.testing.assert_allclose(read(bright, stops), 2.0 ** min(stops, 2.0), rtol=0.02)
    dim = encode_ultra_hdr(0.04 * light, srgb(0.04 * light))
    np.testing.assert_allclose(read(dim, 1.0), 0.16, rtol=0.02)


def test_light_beyond_the_headroom_is_clipped_and_below_black_is_black() -> None:
    light = wall(2.0**3)
    light[:PATCH] = -1
    light[PATCH : 2 * PATCH, :PATCH] = np.inf
    shown = read(encode_ultra_hdr(light, srgb(light)))
    expected = np.clip(light, 0, 2.0**HEADROOM)
    assert patches(shown)[0].max() < 0.002
    np.testing.assert_allclose(patches(shown)[1:], patches(expected)[1:], rtol=0.05, atol=0.002)


def test_a_real_photograph(rig_data: Path) -> None:
    """Light of a church, its median as middle grey."""
    light = read_hdr(rig_data / "radiance" / "Grace_Cathedral.hdr")[::2, ::2]
    light = np.float32(light * 0.18 / np.median(light))
    assert (light > 1).mean() > 0.05
    data = encode_ultra_hdr(light, srgb(light))
    base = np.asarray(Image.open(io.BytesIO(data)), int)
    assert np.abs(base - srgb(light)).mean() < 1
    truth = np.clip(light, 0, 2.0**HEADROOM) @ LUMINANCE
    lit = truth > 2.0**-6
    off = np.abs(np.log2((read(data) @ LUMINANCE)[lit] / truth[lit]))
    assert np.median(off) < 0.02
    assert np.quantile(off, 0.95) < 0.06
