"""Pictures, and their code values in files of other encoders."""

from io import BytesIO
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from imaging.files.photo import read_photo

RNG = np.random.default_rng(7)
RGB8 = RNG.integers(0, 256, (21, 30, 3), dtype=np.uint8)
RGB16 = RNG.integers(0, 65536, (21, 30, 3), dtype=np.uint16)


def codes(path: Path, data: bytes) -> np.ndarray:
    """Code values of a file with this content, as whole numbers again."""
    path.write_bytes(data)
    photo = read_photo(path)
    assert photo.pixels.dtype == np.float32
    assert photo.pixels.ndim == 3
    assert photo.pixels.min() >= 0
    assert photo.pixels.max() <= 1
    largest = {8: 255, 16: 65535}[photo.bit_depth]
    return np.round(photo.pixels.astype(np.float64) * largest).astype(
        {8: np.uint8, 16: np.uint16}[photo.bit_depth]
    )


def tiff(pixels: np.ndarray, **options: object) -> bytes:
    buffer = BytesIO()
    tifffile.imwrite(buffer, pixels, **options)
    return buffer.getvalue()


def pillow(image: Image.Image, kind: str, **options: object) -> bytes:
    buffer = BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()
