"""Settings that a camera kept, from files that state them, do not, or cannot."""

import os
from pathlib import Path

import numpy as np
import pytest

from calib.data.views import scene_views
from calib.light.constant_settings import Stated, stated_by
from capture.imports.photos import import_photos
from imaging.files.photo import encode_jpeg
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.session import Session
from imaging.session.view_id import ViewId

DAYLIGHT = Exposure(time=1 / 80, f_number=5.0, iso=400.0)


def stated(folder: Path, exposures: list[Exposure | None], *, by_hand: bool = False) -> Stated:
    """Statements of JPEGs with these exposures."""
    rng = np.random.default_rng(0)
    (folder / "photos").mkdir()
    for number, exposure in enumerate(exposures):
        metadata = FrameMetadata("Maker", "M1", "7", exposure, manual_white_balance=by_hand)
        pixels = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
        (folder / "photos" / f"{number}.jpg").write_bytes(encode_jpeg(pixels, metadata=metadata))
    import_photos(folder / "photos", folder / "S", bracket=1)
    session = Session.open(folder / "S")
    return stated_by(session, scene_views(session))


def test_one_exposure_in_all_files_is_said_and_a_white_balance_that_is_chosen_is_not(tmp_path: Path) -> None:
    by_files = stated(tmp_path, [DAYLIGHT] * 3)
    (said,) = by_files.exposure.values()
    assert said == "the files state that every view was taken at 1/80 s f/5 ISO 400"
    assert not by_files.white_balance


def test_a_white_balance_that_was_set_is_said(tmp_path: Path) -> None:
    by_files = stated(tmp_path, [DAYLIGHT, DAYLIGHT.with_time(1 / 100)], by_hand=True)
    assert not by_files.exposure
    (said,) = by_files.white_balance.values()
    assert "set by hand" in said


@pytest.mark.parametrize("exposures", [[None, None, None], [DAYLIGHT, DAYLIGHT, DAYLIGHT.with_time(0.1)]])
def test_files_without_exposures_or_with_different_ones_say_nothing(
    tmp_path: Path, exposures: list[Exposure | None]
) -> None:
    assert not stated(tmp_path, exposures).exposure


def test_a_camera_speaks_for_its_own_photographs_alone() -> None:
    said = Stated({"left": "L", "right": "R"})
    left, right, other = (ViewId(0, name) for name in ("left", "right", "other"))
    assert said.of_all("exposure", [left, right]) == "L; R"
    assert said.of_all("exposure", [left, other]) == ""
    assert said.of_all("white_balance", [left]) == ""


def test_gains_of_a_makers_note_are_one_white_balance_where_they_hardly_differ(tmp_path: Path) -> None:
    """Sixteen photographs of a Nikon on automatic white balance, which stayed within half a per cent."""
    photos = Path(os.environ.get("RIG_DATA", "")) / "banana"
    if not photos.is_dir():
        pytest.skip("RIG_DATA has no banana")
    import_photos(photos, tmp_path / "S", bracket=1)
    session = Session.open(tmp_path / "S")
    by_files = stated_by(session, scene_views(session))
    assert [*by_files.white_balance.values()] == [
        "the files state that red was raised 1.77 times and blue 1.53 times in all"
    ]
    assert [*by_files.exposure.values()] == [
        "the files state that every view was taken at 1/80 s f/5 ISO 400"
    ]
