"""The sharpest frames of a video become photographs of one camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.files.photo import read_photo
from imaging.session.session import Session


def test_of_every_half_second_the_sharpest_frame_is_taken(tmp_path):
    rng = np.random.default_rng(0)
    cells = [rng.integers(20, 235, (12, 16, 3)).astype(np.uint8) for _ in range(3)]
    sharp = [cv2.resize(one, (128, 96), interpolation=cv2.INTER_NEAREST) for one in cells]
    frames = [one if n == 3 else cv2.GaussianBlur(one, (0, 0), 4) for one in sharp for n in range(5)]
    clip = tmp_path / "clip.mp4"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter_fourcc(*"mp4v"), 10, (128, 96))
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    said = []
    result = import_photos(
        clip, tmp_path / "s", on_progress=lambda message, done, total: said.append(message)
    )
    assert (result.cameras, result.frames, result.missing) == (1, 3, ())
    assert "3 frames of clip.mp4 are taken, the sharpest of every 5 (0.5 s)" in result.guesses[0]
    assert "reading the video" in said
    session = Session.open(tmp_path / "s")
    for shot, expected in zip(session.shots(), sharp, strict=True):
        there = read_photo(session.file(shot)).pixels
        blurred = cv2.GaussianBlur(expected, (0, 0), 4)
        assert np.abs(there - expected / 255).mean() < 0.5 * np.abs(there - blurred / 255).mean()


def test_what_is_no_video_is_refused_and_leaves_nothing(tmp_path):
    clip = Path(tmp_path / "clip.mp4")
    clip.write_bytes(b"no video")
    with pytest.raises(InputError, match=r"clip\.mp4 cannot be read as a video"):
        import_photos(clip, tmp_path / "s")
    assert not (tmp_path / "s").exists()
