"""Parts of a decoded shot that are held in memory."""

from pathlib import Path

import numpy as np

from imaging.files.photo import encode_png
from imaging.session.calibration import Response
from recon.data.pixels import ShotSource, read_shot
from recon.data.shot import Shot


def read(folder: Path, codes: np.ndarray) -> Shot:
    """A shot of codes [H, W, 3]."""
    path = folder / "photo.png"
    path.write_bytes(encode_png(codes))
    return read_shot(ShotSource(path, path.name, "ldr", Response(kind="srgb", evidence="test")), 1.0)[0]


def held(mask: np.ndarray) -> int:
    """Bytes that a mask has in memory, each counted once."""
    low, high = np.lib.array_utils.byte_bounds(mask)
    return high - low


def test_masks_that_are_the_same_everywhere_take_a_byte(tmp_path: Path) -> None:
    shot = read(tmp_path, np.full((20, 30, 3), 128, np.uint8))
    for mask, value in ((shot.saturated, False), (shot.dark, False), (shot.valid, True)):
        assert mask.shape == (20, 30, 3)
        assert (mask == value).all()
        assert held(mask) == 1


def test_masks_of_some_pixels_are_kept_whole(tmp_path: Path) -> None:
    codes = np.full((20, 30, 3), 128, np.uint8)
    codes[3, 4], codes[19, 29, 2] = 255, 0
    shot = read(tmp_path, codes)
    assert np.array_equal(shot.saturated, codes == 255)
    assert np.array_equal(shot.dark, codes == 0)
    assert held(shot.valid) == 1
