"""Pictures for HDR screens, read by programs and formulas other than those that wrote them."""

import io
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from imaging.colour import PRIMARIES, rec709_from_rgb, srgb_decode
from imaging.files.hdr_display import BRIGHTEST, HEADROOM, WHITE, encode_avif, encode_ultra_hdr, pq_encode

STOPS = np.arange(-7.0, HEADROOM + 1)
COLOURS = np.array([[1, 1, 1], [1, 0.4, 0.2], [0.3, 1, 0.4], [0.2, 0.4, 1]])
PATCH = 32
D50 = (0.3457, 0.3585)  # white of ICC profiles
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def wall(most: float = 1.0) -> np.ndarray:
    """Patches of colours, a row each, and of light in stops from white, a column each."""
    light = COLOURS[:, None] * 2.0 ** STOPS[None, :, None] * most
    return light.repeat(PATCH, 0).repeat(PATCH, 1).astype(np.float32)


def patches(picture: np.ndarray) -> np.ndarray:
    """The middles of the patches, [colours, stops, 3]."""
    return picture[PATCH // 2 :: PATCH, PATCH // 2 :: PATCH]


def stops_off(shown: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Stops of luminance between patches."""
    return np.abs(np.log2(patches(shown) @ LUMINANCE) - np.log2(patches(truth) @ LUMINANCE))


def pq_light(codes: np.ndarray) -> np.ndarray:
    """cd/m2 of codes 0..1, as ITU-R BT.2100-2 writes the EOTF."""
    power = codes ** (1 / 78.84375)
    share = np.maximum(power - 0.8359375, 0) / (18.8515625 - 18.6875 * power)
    return 10_000 * share ** (1 / 0.1593017578125)


def test_pq_has_the_codes_of_its_standard() -> None:
    """As BT.2408 lists them, in percent."""
    codes = pq_encode(np.array([0, 100, WHITE, 1000, 4000, 10_000]))
    np.testing.assert_allclose(codes, [0, 0.508, 0.581, 0.752, 0.903, 1], atol=6e-4)
    light = np.geomspace(0.01, 10_000, 50)
    np.testing.assert_allclose(pq_light(pq_encode(light)), light, rtol=1e-6)


def test_another_decoder_reads_the_light_of_an_avif(tmp_path: Path) -> None:
    """dav1d by ffmpeg, and the published curve."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    light = wall()
    (tmp_path / "wall.avif").write_bytes(encode_avif(light))
    arguments = [ffmpeg, "-i", str(tmp_path / "wall.avif"), "-f", "rawvideo", "-pix_fmt", "gbrp16le", "-"]
    done = subprocess.run(arguments, capture_output=True, check=True)
    assert b"yuv444p10le(pc, bt2020nc/bt2020/smpte2084" in done.stderr
    planes = np.frombuffer(done.stdout, "<u2").reshape(3, *light.shape[:2]) / 65535
    rec2020 = pq_light(np.stack([planes[2], planes[0], planes[1]], -1))
    shown = rec2020 @ rec709_from_rgb(PRIMARIES["rec2020"]).T / WHITE
    assert stops_off(shown, light).max() < 0.05
    assert patches(shown).max() == pytest.approx(2.0**HEADROOM, rel=0.02)
    assert np.abs(np.log2(patches(shown)[:, 4:] / patches(light)[:, 4:])).max() < 0.1  # of each channel


class GainMap:
    """An Ultra HDR JPEG, read by CIPA DC-007 (MPF), JPEG, and ISO 21496-1."""

    def __init__(self, data: bytes) -> None:
        start = data.index(b"MPF\0") + 4  # little or big endian, as its header says
        order = {b"II": "<", b"MM": ">"}[data[start : start + 2]]
        (tags,) = struct.unpack_from(f"{order}H", data, start + 8)
        entries = {}
        for number in range(tags):
            tag, _, _, value = struct.unpack_from(f"{order}HHII", data, start + 10 + 12 * number)
            entries[tag] = value
        size, offset = struct.unpack_from(f"{order}II", data, start + entries[0xB002] + 16 + 4)
        second = data[start + offset : start + offset + size]
        picture = Image.open(io.BytesIO(data))
        profile = ImageCms.ImageCmsProfile(io.BytesIO(picture.info["icc_profile"])).profile
        corners = (profile.red_primary, profile.green_primary, profile.blue_primary)
        self._rec709_from_base = rec709_from_rgb([*(place[1][:2] for place in corners), D50])
        self.base = np.asarray(picture.convert("RGB")) / 255
        self.map = np.asarray(Image.open(io.BytesIO(second)).convert("RGB")) / 255
        mark = b"urn:iso:std:iso:ts:21496:-1\0"
        self._numbers(second[second.index(mark) + len(mark) :])

    def _numbers(self, body: bytes) -> None:
        flags = body[4]
        channels, common = 3 if flags & 0x80 else 1, bool(flags & 0x08)
        place = 5

        def take(kind: str) -> int:
            nonlocal place
            (value,) = struct.unpack_from(f">{kind}", body, place)
            place += 4
            return value

        shared = take("I") if common else 0

        def fraction(kind: str) -> float:
            value = take(kind)
            return value / (shared if common else take("I"))

        self.headrooms = fraction("I"), fraction("I")
        rows = [[fraction(kind) for kind in "iiIii"] for _ in range(channels)]
        self.least, self.most, self.gamma, self.base_offset, self.offset = np.array(rows).T

    def shown(self, headroom: float) -> np.ndarray:
        """Linear Rec.709 on a screen of that many stops above white, by the formula of the standard."""
        low, high = self.headrooms
        weight = np.clip((headroom - low) / (high - low), 0, 1)
        gain = self.least + (self.most - self.least) * self.map ** (1 / self.gamma)
        light = (srgb_decode(self.base) + self.base_offset) * 2.0 ** (weight * gain) - self.offset
        return light @ self._rec709_from_base.T


def test_the_formula_of_gain_maps_gives_the_light_of_an_ultra_hdr_jpeg() -> None:
    light = wall()
    read = GainMap(encode_ultra_hdr(light))
    assert read.map.shape == read.base.shape == light.shape
    assert read.headrooms == pytest.approx((0, HEADROOM), abs=0.01)
    off = stops_off(read.shown(HEADROOM), light)
    assert np.median(off) < 0.02
    assert off[:, 1:].max() < 0.05
    assert np.abs(np.log2(patches(read.shown(HEADROOM))[:, 4:] / patches(light)[:, 4:])).max() < 0.15
    # On a screen without headroom it is its own picture: below white everywhere, in the order of the light.
    plain = patches(read.shown(0)) @ LUMINANCE
    assert (np.diff(plain, axis=1) > 0).all()
    assert plain[0, 7] == pytest.approx(0.5, abs=0.1)
    assert plain[0, -1] > 0.9


@pytest.mark.parametrize("encode", [encode_avif, encode_ultra_hdr])
def test_more_light_than_the_headroom_is_clipped_and_less_than_none_is_black(encode, tmp_path: Path) -> None:
    light = wall(2.0**3)
    light[:PATCH] = -1
    light[PATCH : 2 * PATCH, :PATCH] = np.inf
    assert len(encode(light)) > 500
    expected = np.clip(light, 0, 2.0**HEADROOM)
    if encode is encode_ultra_hdr:
        shown = GainMap(encode(light)).shown(HEADROOM)
        assert patches(shown)[1, 0].min() == pytest.approx(2.0**HEADROOM, rel=0.05)
        assert patches(shown).max() < 1.05 * 2.0**HEADROOM
        assert patches(shown)[0].max() < 0.002
        np.testing.assert_allclose(patches(shown)[2:], patches(expected)[2:], rtol=0.1, atol=0.01)
    assert BRIGHTEST == WHITE * 2.0**HEADROOM


def test_the_sdr_picture_keeps_room_above_white() -> None:
    """As docs/render.md has it: white is code 188 there."""
    base = GainMap(encode_ultra_hdr(np.ones((PATCH, PATCH, 3), np.float32))).base
    np.testing.assert_allclose(255 * base, 188, atol=1.5)
