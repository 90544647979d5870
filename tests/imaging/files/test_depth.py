"""Depth maps of each kind of file, against what was written by OpenCV, OpenEXR and NumPy."""

import cv2
import numpy as np
import OpenEXR
import pytest

from imaging.errors import InputError
from imaging.files.depth import read_depth, require_shape

CODES = np.array([[0, 1, 1500], [65534, 65535, 7]], np.uint16)
LIGHT = np.array([[0.5, -1.0, np.nan], [np.inf, 0.0, 2.25]], np.float32)
KNOWN = np.array([[0.5, 0, 0], [0, 0, 2.25]], np.float32)


def test_codes_of_16_bits_are_kept_and_the_last_one_is_beyond_the_sensor(tmp_path):
    for name in ("a.png", "a.tif"):
        cv2.imwrite(str(tmp_path / name), CODES)
        depth, whole = read_depth(tmp_path / name)
        assert whole
        np.testing.assert_array_equal(depth, np.where(CODES == 65535, 0, CODES))


@pytest.mark.parametrize("channel", ["Z", "depth.Z", "Y", "R"])
def test_exr_by_the_names_of_its_channels(tmp_path, channel):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {channel: LIGHT} | ({"G": LIGHT * 3, "B": LIGHT * 5} if channel == "R" else {})
    OpenEXR.File(header, planes).write(str(tmp_path / "a.exr"))
    depth, whole = read_depth(tmp_path / "a.exr")
    assert not whole
    np.testing.assert_array_equal(depth, KNOWN)


@pytest.mark.parametrize(
    ("values", "expected", "is_whole"),
    [
        (LIGHT, KNOWN, False),
        (LIGHT.astype(np.float64)[..., None], KNOWN, False),
        (np.array([[1e300, 3.0]]), [[0, 3]], False),
        (np.array([[-4, 2000]], np.int32), [[0, 2000]], True),
    ],
)
def test_arrays_whatever_is_not_a_depth_in_them_is_unknown(tmp_path, values, expected, is_whole):
    np.save(tmp_path / "a.npy", values)
    depth, whole = read_depth(tmp_path / "a.npy")
    assert whole == is_whole
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth, expected)


def test_what_is_no_depth_map_is_refused_in_a_sentence(tmp_path):
    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((4, 4), np.uint8))
    cv2.imwrite(str(tmp_path / "rgb.png"), np.zeros((4, 4, 3), np.uint16))
    np.save(tmp_path / "words.npy", np.array([["a"]]))
    np.save(tmp_path / "objects.npy", np.array([[None]]), allow_pickle=True)
    np.save(tmp_path / "line.npy", np.zeros(4))
    np.save(tmp_path / "none.npy", np.zeros((0, 4)))
    np.save(tmp_path / "whole.npy", np.ones((40, 40)))
    (tmp_path / "cut.npy").write_bytes((tmp_path / "whole.npy").read_bytes()[:-9])
    (tmp_path / "bomb.npy").write_bytes(
        (tmp_path / "whole.npy").read_bytes().replace(b"(40, 40)", b"(4e9, 4)"[:8])
    )
    (tmp_path / "text.exr").write_text("no")
    cv2.imwrite(str(tmp_path / "whole.png"), np.ones((40, 40), np.uint16))
    (tmp_path / "cut.png").write_bytes((tmp_path / "whole.png").read_bytes()[:-30])
    names = (
        "grey.png rgb.png words.npy objects.npy line.npy none.npy cut.npy bomb.npy text.exr cut.png no.png"
    )
    for name in names.split():
        with pytest.raises(InputError) as error:
            read_depth(tmp_path / name)
        assert name in str(error.value)
        assert str(error.value).endswith(".")


def test_coarser_maps_have_the_proportions_of_their_photographs(tmp_path):
    for rows, columns in ((1440, 1920), (192, 256), (193, 256), (6, 8)):
        require_shape(tmp_path / "a.png", np.ones((rows, columns), np.float32), 1440, 1920)
    for rows, columns in ((1920, 1440), (256, 256), (186, 256)):
        with pytest.raises(InputError, match=rf"has {columns}x{rows} pixels and its photograph 1920x1440"):
            require_shape(tmp_path / "a.png", np.ones((rows, columns), np.float32), 1440, 1920)
