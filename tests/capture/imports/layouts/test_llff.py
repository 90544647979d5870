from pathlib import Path

import numpy as np
import pytest

from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.session.calibration import read_calibration
from imaging.session.session import Session

COUNT = 5
POINTS = np.random.default_rng(2).uniform([-1, -1, 4], [1, 1, 6], (20, 3))


def row(x: float) -> np.ndarray:
    """A camera at (x, 0, 0) that looks along z, x right and y down; LLFF's columns are down, right, back."""
    return np.stack([(0, 1, 0), (1, 0, 0), (0, 0, -1), (x, 0, 0)], axis=1).astype(float)


def scene(folder: Path, picture, put, names=None, apart=False) -> Path:
    """Write a scene for the loader of HDR-Plenoxels; apart: the lens in a file of its own."""
    for number, name in enumerate(names or [f"{n:03d}.png" for n in range(COUNT)]):
        put(folder / "images" / name, picture(number))
    lens = np.array([[96.0], [128.0], [140.0]])  # twice the size of the photos
    rows = [np.r_[(row(x) if apart else np.hstack([row(x), lens])).ravel(), 1.0, 9.0] for x in range(COUNT)]
    np.save(folder / "poses_bounds.npy", np.array(rows))
    if apart:
        np.save(folder / "hwf_cxcy.npy", np.array([96.0, 128.0, 140.0, 150.0, 60.0, 50.0]))
    return folder


def imported(folder: Path):
    result = import_photos(folder, folder.parent / "s")
    session = Session.open(folder.parent / "s")
    return result, session, read_calibration(session.folder)


@pytest.mark.parametrize("apart", [False, True])
def test_views_see_what_their_rows_say(tmp_path, picture, put, seen_at, apart):
    result, session, record = imported(scene(tmp_path / "h", picture, put, apart=apart))
    assert (result.layout, result.frames, result.views) == ("llff", COUNT, COUNT)
    focal, middle = ((70, 75), (30, 25)) if apart else ((70, 70), (32, 24))
    for shot in session.shots():
        away = POINTS - [int(Path(shot.source).stem), 0, 0]
        expected = np.stack([f * away[:, i] / away[:, 2] + middle[i] for i, f in enumerate(focal)], axis=1)
        pixels = seen_at(record, shot.camera, shot.frame, POINTS)
        np.testing.assert_allclose(pixels, expected, atol=1e-6)


def test_the_number_of_a_split_does_not_count_in_the_order_of_names(tmp_path, picture, put):
    names = ["1_000.png", "0_001.png", "0_002.png", "1_003.png", "0_004.png"]
    result, session, record = imported(scene(tmp_path / "h", picture, put, names=names))
    assert any("without the number of the split" in guess for guess in result.guesses)
    at = {view.frame: -view.cam_from_world.matrix()[0, 3] for view in record.views}
    assert {Path(s.source).name: at[s.frame] for s in session.shots()} == dict(
        zip(names, range(5), strict=True)
    )


def test_rows_that_do_not_fit_the_images_are_refused(tmp_path, picture, put):
    folder = scene(tmp_path / "h", picture, put)
    put(folder / "images" / "more.png", picture(9))
    with pytest.raises(InputError, match=r"poses_bounds\.npy has 5 rows for 6 photos"):
        imported(folder)
    np.save(folder / "hwf_cxcy.npy", np.full(6, np.nan))
    with pytest.raises(InputError, match=r"poses_bounds\.npy has the shape \[5, 17\], not \[photos, 14\]"):
        imported(folder)
    np.save(folder / "poses_bounds.npy", np.zeros((6, 14)))
    with pytest.raises(InputError, match=r"hwf_cxcy\.npy has photos of nanxnan pixels"):
        imported(folder)
    (folder / "hwf_cxcy.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(InputError, match=r"hwf_cxcy\.npy cannot be read"):
        imported(folder)
    assert {path.name for path in tmp_path.iterdir()} == {"h"}
