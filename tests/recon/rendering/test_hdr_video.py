"""Films for HDR screens, decoded by another program and the published curve."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from imaging.colour import PRIMARIES, rec709_from_rgb
from imaging.errors import InputError
from imaging.files.hdr_display import HEADROOM, WHITE
from recon.rendering.video import HdrVideo
from tests.imaging.files.test_hdr_display import PATCH, patches, pq_light, stops_off, wall


def decoded(film: Path) -> tuple[str, np.ndarray]:
    """Notes of ffmpeg on a film, and its frames as linear Rec.709, 1 as white."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    arguments = ["-i", str(film), "-vf", "showinfo,zscale=matrix=gbr:range=full", "-f", "rawvideo"]
    done = subprocess.run(
        [ffmpeg, *arguments, "-pix_fmt", "gbrp16le", "-"], capture_output=True, check=True, timeout=60
    )
    said = done.stderr.decode()
    width, height = (int(side) for side in re.search(r"yuv420p10le.*? (\d+)x(\d+)", said).groups())
    planes = np.frombuffer(done.stdout, "<u2").reshape(-1, 3, height, width) / 65535
    rec2020 = pq_light(np.moveaxis(planes[:, [2, 0, 1]], 1, -1))
    return said, rec2020 @ rec709_from_rgb(PRIMARIES["rec2020"]).T / WHITE


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
