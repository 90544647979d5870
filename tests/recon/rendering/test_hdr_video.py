"""Films for HDR screens, decoded by another program and the published curve."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from imaging.colour.spaces import PRIMARIES, rec709_from_rgb
from imaging.errors import InputError
from imaging.files.hdr_display import HEADROOM, WHITE
from recon.rendering.video import HdrVideo, HlgVideo
from tests.imaging.files.test_hdr_display import PATCH, hlg_light, patches, pq_light, stops_off, wall


def decoded(film: Path, light_of: Callable[[np.ndarray], np.ndarray] = pq_light) -> tuple[str, np.ndarray]:
    """Notes of ffmpeg on a film, and its frames as linear Rec.709, 1 as white, by the curve of its codes."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    arguments = ["-i", str(film), "-vf", "showinfo,zscale=matrix=gbr:range=full", "-f", "rawvideo"]
    done = subprocess.run(
        [ffmpeg, *arguments, "-pix_fmt", "gbrp16le", "-"], capture_output=True, check=True, timeout=60
    )
    said = done.stderr.decode()
    width, height = (int(side) for side in re.search(r"yuv420p10le.*? (\d+)x(\d+)", said).groups())
    planes = np.frombuffer(done.stdout, "<u2").reshape(-1, 3, height, width) / 65535
    rec2020 = light_of(np.moveaxis(planes[:, [2, 0, 1]], 1, -1))
    return said, rec2020 @ rec709_from_rgb(PRIMARIES["rec2020"]).T / WHITE


def linear_by_zimg(film: Path, shape: tuple[int, ...]) -> np.ndarray:
    """The frames [N, H, W, 3] of a film as linear Rec.709, 1 as white, by zimg alone."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    linear = f"zscale=matrix=gbr:range=full:transfer=linear:npl={WHITE:.0f}:agamma=0,format=gbrpf32le"
    asked = ["-i", str(film), "-vf", linear, "-f", "rawvideo", "-pix_fmt", "gbrpf32le", "-"]
    done = subprocess.run([ffmpeg, *asked], capture_output=True, check=True, timeout=60)
    planes = np.frombuffer(done.stdout, "<f4").reshape(-1, 3, *shape[:2])
    return np.moveaxis(planes[:, [2, 0, 1]], 1, -1) @ rec709_from_rgb(PRIMARIES["rec2020"]).T


def test_a_film_has_the_light_and_says_how_bright_it_is(tmp_path: Path) -> None:
    light = wall()
    darker = light / 8
    with HdrVideo(tmp_path / "a.hdr.mp4", 24) as film:
        for picture in (darker, light, darker):
            film.add(picture)
    assert [path.name for path in tmp_path.iterdir()] == ["a.hdr.mp4"]
    said, shown = decoded(tmp_path / "a.hdr.mp4")
    assert re.search(r"hevc \(Main 10\) \(hvc1.*yuv420p10le\(tv, bt2020nc/bt2020/smpte2084", said)
    assert len(shown) == 3
    for picture, frame in zip((darker, light, darker), shown, strict=True):
        off = stops_off(frame, picture)
        assert np.median(off) < 0.02
        assert off.max() < 0.05
    assert patches(shown[1]).max() == pytest.approx(2.0**HEADROOM, rel=0.03)
    rec2020 = light @ np.linalg.inv(rec709_from_rgb(PRIMARIES["rec2020"])).T * WHITE
    brightest, mean = rec2020.max(), rec2020.max(axis=-1).mean()
    assert re.search(rf"MaxCLL={brightest:.0f}, MaxFALL={mean:.0f}", said)
    assert re.search(r"max_luminance=3248\.", said)
    assert "r(0.6400,0.3300) g(0.3000,0.6000) b(0.1500 0.0600) wp(0.3127, 0.3290)" in said


def test_a_film_of_hlg_has_the_light_up_to_its_display(tmp_path: Path) -> None:
    light = wall()
    darker = light / 8
    with HlgVideo(tmp_path / "a.hlg.mp4", 24) as film:
        for picture in (darker, light):
            film.add(picture)
    said, shown = decoded(tmp_path / "a.hlg.mp4", hlg_light)
    assert re.search(r"hevc \(Main 10\) \(hvc1.*yuv420p10le\(tv, bt2020nc/bt2020/arib-std-b67", said)
    assert len(shown) == 2
    off = stops_off(shown[0], darker)
    assert np.median(off) < 0.02
    assert off.max() < 0.05
    assert patches(shown[1])[0].max() == pytest.approx(1000 / WHITE, rel=0.02)
    # zimg has the display's gamma of its own; npl: what it calls 1.
    off = stops_off(linear_by_zimg(tmp_path / "a.hlg.mp4", light.shape)[0], darker)
    assert np.median(off) < 0.02
    assert off.max() < 0.05


def test_odd_sizes_are_even_and_other_sizes_refused(tmp_path: Path) -> None:
    with HdrVideo(tmp_path / "a.hdr.mp4", 24) as film:
        film.add(np.ones((2 * PATCH + 1, 2 * PATCH - 1, 3), np.float32))
    _, shown = decoded(tmp_path / "a.hdr.mp4")
    assert shown.shape == (1, 2 * PATCH + 2, 2 * PATCH, 3)
    np.testing.assert_allclose(shown, 1, rtol=0.03)
    film = HdrVideo(tmp_path / "b.hdr.mp4", 24)
    film.add(np.ones((PATCH, PATCH, 3), np.float32))
    with pytest.raises(InputError, match="of one size"), film:
        film.add(np.ones((PATCH, 2 * PATCH, 3), np.float32))
    assert [path.name for path in tmp_path.iterdir()] == ["a.hdr.mp4"]
