"""Masks as pictures: what is black or transparent in them does not count."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from imaging.errors import InputError
from imaging.files.photo import encode_png
from imaging.merge.masks import read_mask


@pytest.mark.parametrize("kind", ["grey", "rgb", "grey+alpha", "rgba", "16 bit", "palette", "1 bit", "tiff"])
def test_what_is_black_or_transparent_does_not_count(tmp_path: Path, kind: str) -> None:
    grey = np.zeros((6, 8), np.uint8)
    grey[:, 4:] = 255
    grey[0, 4] = 1
    alpha = np.full((6, 8), 255, np.uint8)
    alpha[3:] = 0
    alpha[2, 7] = 1
    image = {
        "grey": grey,
        "rgb": np.dstack([grey * 0, grey, grey * 0]),
        "grey+alpha": np.dstack([grey, alpha]),
        "rgba": np.dstack([grey, grey, grey, alpha]),
        "16 bit": grey.astype(np.uint16),
    }.get(kind)
    path = tmp_path / "m.png"
    if image is not None:
        path.write_bytes(encode_png(image))
    elif kind == "tiff":
        both = np.dstack([grey, grey, grey, alpha])
        tifffile.imwrite(path, both, photometric="rgb", extrasamples=["unassalpha"])
    else:
        Image.fromarray(grey).convert("P" if kind == "palette" else "1", dither=Image.Dither.NONE).save(path)
    expected = grey > (127 if kind == "1 bit" else 0)
    if kind in ("grey+alpha", "rgba", "tiff"):
        expected = expected & (alpha > 0)
    assert np.array_equal(read_mask(path, 6, 8), expected)


@pytest.mark.parametrize(
    "data", [b"", b"nothing", encode_png(np.ones((6, 8), np.uint8))[:-20], b"GIF89a" * 9]
)
def test_what_is_no_mask_is_refused_in_one_sentence(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "m.png"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"^The mask \S+ is .*: (make it again as a PNG|convert it).*\.$"):
        read_mask(path, 6, 8)


def test_a_mask_of_another_size_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.png").write_bytes(encode_png(np.ones((6, 8), np.uint8)))
    with pytest.raises(InputError, match="has 8x6 pixels and its photograph 9x6: make it of the same size"):
        read_mask(tmp_path / "m.png", 6, 9)
