"""A lens taken out and put back in, against OpenCV, and against itself."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from imaging.files.exr.reading import read_exr
from imaging.optics.lens import Lens
from imaging.plates.lens_maps import redistorting, undistorting, warped, write_stmap

SIZE = {"width": 320, "height": 240, "fx": 250.0, "fy": 252.0, "cx": 163.0, "cy": 118.0}
LENSES = [
    Lens(model="OPENCV", k1=-0.12, k2=0.03, p1=1e-3, p2=-2e-3, **SIZE),
    Lens(model="OPENCV", k1=0.08, k2=-0.01, **SIZE),
    Lens(model="OPENCV_FISHEYE", k1=0.05, k2=-0.02, k3=0.004, k4=-0.001, **SIZE),
]
EVERY = pytest.mark.parametrize("lens", LENSES, ids=("barrel", "pincushion", "fisheye"))


@EVERY
def test_places_are_those_of_opencv(lens: Lens) -> None:
    matrix = np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1]])
    terms, size = np.array(lens.terms[4:]), (lens.width, lens.height)
    module = cv2.fisheye if lens.fisheye else cv2
    x, y = module.initUndistortRectifyMap(matrix, terms, np.eye(3), matrix, size, cv2.CV_32FC1)
    np.testing.assert_allclose(undistorting(lens) - 0.5, np.dstack([x, y]), atol=1e-3)


@EVERY
def test_out_of_stmaps_and_back_is_the_same_place(lens: Lens, tmp_path: Path) -> None:
    """As a compositor has them: both read from their files, one looked up by the other."""
    places = {}
    for name, made in (("undistort", undistorting(lens)), ("redistort", redistorting(lens))):
        write_stmap(tmp_path / f"{name}.exr", made, name)
        image = read_exr(tmp_path / f"{name}.exr")
        assert image.attributes["colorInteropID"] == "data"
        across, up = image.channels["R"], image.channels["G"]
        places[name] = np.dstack([across * lens.width, (1 - up) * lens.height]).astype(np.float64)
        assert np.array_equal(across == -1, np.isnan(made[..., 0]))
    again, known = warped(places["undistort"].astype(np.float32), places["redistort"])
    x, y = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    inside = known > 0.9999
    assert inside.mean() > 0.7
    assert np.abs(again - np.dstack([x, y]))[inside].max() < 0.02


def test_what_is_no_number_stays_out_of_its_neighbours() -> None:
    lens = LENSES[0]
    picture = np.full((lens.height, lens.width, 3), 7.0, np.float32)
    picture[100:110, 150:170] = np.nan
    straight, known = warped(picture, undistorting(lens))
    assert np.isfinite(straight).all()
    assert (known < 0.01).sum() > 100
    np.testing.assert_allclose(straight[known > 0] / known[known > 0][:, None], 7.0, rtol=1e-5)
