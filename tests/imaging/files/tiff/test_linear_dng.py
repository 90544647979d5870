"""Demosaicked light in DNG files, lossless and lossy, against the light that was put in."""

from pathlib import Path

import numpy as np
import pytest
import tifffile

from capture.pictures.read import examine
from imaging.errors import InputError
from imaging.files.raw import read_raw
from imaging.merge.linear_frame import from_raw
from recon.data.pixels import ShotSource, read_shot
from tests.recon.data.test_dataset import LINEAR

HEIGHT, WIDTH = 64, 96
ROOT = np.linspace(0, 1, 256)
TABLE = np.rint(60000 * ROOT**2 + 64).astype(np.uint16)
"""Codes of 8 bits to light, as lossy files have them."""
MATRIX = np.array([9000, -3000, -1000, -4000, 12000, 2000, 0, 2000, 6000])


def light() -> np.ndarray:
    """Light [H, W, 3], 0..1, in which red, green and blue differ everywhere."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH]).reshape(2, 1, 1)
    return np.stack([0.1 + 0.8 * columns, 0.1 + 0.6 * rows, 0.9 - 0.7 * columns], axis=-1)


def write(
    path: Path, codes: np.ndarray, compression: int | str | None, white: int, table: bool = False
) -> Path:
    """A DNG of one directory, LinearRaw, with tiles."""
    tags = [
        (50706, "B", 4, b"\1\6\0\0"),
        (50708, "s", 0, "Maker Model"),
        (50714, "H", 1, 64),
        (50717, "I", 1, white),
        (50721, "2i", 9, np.stack([MATRIX, np.full(9, 10000)], -1).ravel().tolist()),
        (50728, "2I", 3, [1, 2, 1, 1, 3, 4]),
        (50778, "H", 1, 21),
    ]
    if table:
        tags.append((50712, "H", 256, TABLE.tolist()))
    tifffile.imwrite(
        path, codes, photometric=34892, compression=compression, tile=(64, 96), extratags=tags, metadata=None
    )
    return path


@pytest.mark.parametrize(("compression", "error"), [(None, 1e-4), ("jpegxl_dng", 1e-4), (34892, 0.03)])
def test_light_comes_back(tmp_path: Path, compression: int | str | None, error: float) -> None:
    truth = light()
    if compression == 34892:
        codes = np.rint(255 * np.sqrt(truth)).astype(np.uint8)
        path = write(tmp_path / "a.dng", codes, compression, 60064, table=True)
    else:
        path = write(tmp_path / "a.dng", np.rint(60000 * truth + 64).astype(np.uint16), compression, 60064)
    raw = read_raw(path)
    assert raw.cfa is None
    np.testing.assert_allclose(raw.signal(), truth, atol=error)
    assert raw.neutral == (0.5, 1.0, 0.75)
    assert raw.camera_from_rec709 is not None
    frame = from_raw(raw, 0.5)
    assert (frame.cfa, frame.signal.shape, frame.valid.shape) == (None, truth.shape, truth.shape)
    shot, cfa = read_shot(ShotSource(path, "a", "raw", LINEAR, WIDTH // 2), 0.5)
    assert (cfa, shot.pixels.shape) == (None, (HEIGHT // 2, WIDTH // 2, 3))
    np.testing.assert_allclose(shot.pixels.mean((0, 1)), truth.mean((0, 1)), atol=error)
    examined = examine(path)
    assert (examined.picture.kind, examined.picture.width, examined.picture.height) == ("raw", WIDTH, HEIGHT)
    assert examined.reduced is not None


def test_what_is_clipped_is_known_by_channel(tmp_path: Path) -> None:
    codes = np.full((HEIGHT, WIDTH, 3), 20000, np.uint16)
    codes[:8, :, 2] = 60064
    path = write(tmp_path / "a.dng", codes, None, 60064)
    assert examine(path).picture.clipped == (0.0, 0.0, 0.125)
    assert from_raw(read_raw(path), 1.0).saturated.sum() == 8 * WIDTH


def test_levels_that_contradict_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.dng", np.zeros((HEIGHT, WIDTH, 3), np.uint16), None, 60)
    with pytest.raises(InputError, match="cannot be decoded as RAW"):
        read_raw(path)
