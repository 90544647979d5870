"""Pictures for HDR screens, read by programs and formulas other than those that wrote them."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from imaging.colour.spaces import PRIMARIES, rec709_from_rgb
from imaging.files.hdr_display import BRIGHTEST, HEADROOM, WHITE, encode_avif, hlg_encode, pq_encode, within

STOPS = np.arange(-7.0, HEADROOM + 1)
COLOURS = np.array([[1, 1, 1], [1, 0.4, 0.2], [0.3, 1, 0.4], [0.2, 0.4, 1]])
PATCH = 32
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


def hlg_light(codes: np.ndarray) -> np.ndarray:
    """cd/m2 of codes 0..1 [..., 3] on a display of 1000 cd/m2, as ITU-R BT.2100-2 writes the EOTF."""
    dark = codes**2 / 3
    signal = np.where(codes <= 0.5, dark, (np.exp((codes - 0.55991073) / 0.17883277) + 0.28466892) / 12)
    return 1000 * (signal @ [0.2627, 0.6780, 0.0593])[..., None] ** 0.2 * signal


def test_hlg_has_the_codes_of_its_standard() -> None:
    """White is 75 % (BT.2408), and the display shows the light: that of a saturated blue up to 568 cd/m2."""
    codes = hlg_encode(np.array([[0.0] * 3, [WHITE] * 3, [1000.0] * 3, [5000.0] * 3]))
    np.testing.assert_allclose(codes[:, 0], [0, 0.75, 1, 1], atol=2e-4)
    light = np.random.default_rng(0).uniform(0.01, 560, (200, 3))
    np.testing.assert_allclose(hlg_light(hlg_encode(light)), light, rtol=1e-5)
    blue = hlg_light(hlg_encode(np.array([[0.0, 0.0, 900.0]])))
    np.testing.assert_allclose(blue, [[0, 0, 568.3]], atol=0.5)


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


def test_more_light_than_the_headroom_is_clipped_and_less_than_none_is_black() -> None:
    light = wall(2.0**3)
    light[:PATCH] = -1
    light[PATCH : 2 * PATCH, :PATCH] = np.inf
    assert len(encode_avif(light)) > 500
    np.testing.assert_array_equal(within(light), light.clip(0, 2.0**HEADROOM))
    assert BRIGHTEST == WHITE * 2.0**HEADROOM
