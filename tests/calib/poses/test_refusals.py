"""Sessions that cannot be placed: the cause is named, and what was measured stays."""

import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from calib import view_images
from calib.calibrate import calibrate
from calib.view_images import ViewSummary
from imaging.errors import CalibrationError, InputError, PartialError
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.session.calibration import read_calibration
from imaging.session.records import SessionRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from rig.options.board_text import board_text
from tests.calib.conftest import make_session

HEIGHT, WIDTH = 120, 160


def noise(seed: int) -> np.ndarray:
    """A picture full of texture that no other seed shares."""
    rng = np.random.default_rng(seed)
    smooth = ndimage.gaussian_filter(rng.standard_normal((HEIGHT, WIDTH)), 2.0)
    code = np.clip(128 + 50 * smooth / smooth.std(), 0, 255)
    return np.asarray(np.repeat(code[..., None], 3, axis=2), np.uint8)


def plain(code: int) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), code, np.uint8)


@pytest.mark.parametrize(
    ("pictures", "cause"),
    [
        ([noise(0)], "only one view: poses need at least two"),
        ([plain(0)] * 3, "3 of 3 views have too few features, 3 of them are black: expose longer"),
        ([plain(255)] * 3, "are saturated: expose shorter"),
        ([plain(128)] * 3, "are without texture or blurred: focus"),
        ([noise(1), plain(0), plain(0)], "2 of 3 views have too few features"),
        ([noise(2), noise(3), noise(4)], "no two views share enough"),
    ],
    ids=["one", "black", "saturated", "blank", "one of three", "strangers"],
)
def test_nothing_to_place_and_nothing_measured(
    tmp_path: Path, pictures: list[np.ndarray], cause: str
) -> None:
    session = make_session(tmp_path / "S", [[(picture, None)] for picture in pictures])
    with pytest.raises(CalibrationError, match=cause) as refused:
        calibrate(session, on_progress=unreported)
    message = str(refused.value)
    assert message.startswith(str(session))
    assert message.endswith(".")
    assert "\n" not in message
    assert not (session / "calibration").exists()
    assert not list(session.glob(".*"))


def test_no_further_features_are_looked_for_from_one_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They cost minutes, and no feature shows depth there."""
    kinds = []

    def summaries(*given: Any) -> dict[ViewId, ViewSummary]:
        kinds.append(given[3:])
        return view_images.summaries(*given)

    monkeypatch.setattr("calib.place_views.learned.available", lambda: True)
    monkeypatch.setattr("calib.place_views.view_images", SimpleNamespace(summaries=summaries))
    # The same picture three times: all of it matches, without parallax.
    for pictures, cause in (([noise(0)], "only one view"), ([noise(0)] * 3, "show no depth")):
        session = make_session(tmp_path / f"{len(pictures)}", [[(picture, None)] for picture in pictures])
        with pytest.raises(CalibrationError, match=cause):
            calibrate(session, on_progress=unreported)
    assert kinds == [(), ()]


def test_dim_raw_is_called_black(tmp_path: Path) -> None:
    """Read noise is texture to SIFT, but no scene."""
    rng = np.random.default_rng(5)

    def dark() -> RawMosaic:
        pixels = np.rint(256 + 2 * rng.standard_normal((HEIGHT, WIDTH))).astype(np.uint16)
        return RawMosaic(pixels, Cfa.RGGB, ((256,),), 4095, noise_profile=(1e-4, 2.8e-7))

    session = make_session(tmp_path / "S", [[(dark(), Exposure(time=0.01))] for _ in range(3)])
    with pytest.raises(CalibrationError, match="3 of them are black"):
        calibrate(session, on_progress=unreported)


def bracket(seed: int) -> list[tuple[RawMosaic, Exposure]]:
    """RAW exposures of one view, their true times not quite those of their labels."""
    rng = np.random.default_rng(seed)
    radiance = np.exp(rng.uniform(np.log(0.02), np.log(20), (HEIGHT // 8, WIDTH // 8)))
    radiance = radiance.repeat(8, 0).repeat(8, 1)
    shots = []
    for label, time in ((1 / 60, 1 / 64), (1 / 15, 1 / 16), (1 / 4, 1 / 4)):
        electrons = rng.poisson(np.minimum(radiance * time, 1.2) * 9000)
        pixels = np.clip(np.rint(256 + electrons * 0.4), 0, 3856).astype(np.uint16)
        shots.append((RawMosaic(pixels, Cfa.RGGB, ((256,),), 3856), Exposure(time=label)))
    return shots


def test_one_view_keeps_what_its_bracket_says(tmp_path: Path) -> None:
    session = make_session(tmp_path / "S", [bracket(1)])
    with pytest.raises(PartialError, match="exposures and response are measured, but no view has a pose"):
        calibrate(session, on_progress=unreported)
    record = read_calibration(session)
    assert record.views == ()
    assert record.unregistered == (ViewId(0, "cam"),)
    assert record.cameras[0].lens is None
    scale = [record.exposure_scale[f"raw/0000/cam_{step}.dng"] for step in range(3)]
    np.testing.assert_allclose(scale / np.array(scale[2]), [1 / 16, 1 / 4, 1], rtol=5e-3)
    assert "straight line" in record.cameras[0].response.evidence


def add_board_shot(folder: Path) -> None:
    """One picture of kind board, of which the session does not say what it shows."""
    session = Session.open(folder)
    (shot,) = [one for one in session.shots("scene") if one.step == 0]
    file = folder / "raw" / "0009" / "cam_0.dng"
    file.parent.mkdir()
    file.write_bytes((folder / shot.file).read_bytes())
    update = {"kind": "board", "plan": "board", "frame": 9, "file": "raw/0009/cam_0.dng"}
    session.append_shot(shot.model_copy(update=update))


def test_a_board_that_nothing_describes_is_left_out_alone(tmp_path: Path) -> None:
    """Everything else is measured; the command that is named can be pasted, and its board is remembered."""
    session = make_session(tmp_path / "a session", [bracket(1)])
    add_board_shot(session)
    with pytest.raises(PartialError, match="The board was left out: nothing describes it") as refused:
        calibrate(session, on_progress=unreported)
    assert "straight line" in read_calibration(session).cameras[0].response.evidence
    words = shlex.split(str(refused.value).split("`")[1])
    assert words[:3] == ["rig", "calibrate", str(session)]
    described = board_text(words[4]).board()
    with pytest.raises(PartialError, match="No picture shows a board of 7 x 5 squares"):
        calibrate(session, board=described, on_progress=unreported)


def test_one_view_keeps_the_colour_that_its_file_names(tmp_path: Path) -> None:
    """One RAW photograph without a bracket: no pose, but what `rig merge` needs to leave camera RGB."""
    raw, exposure = bracket(1)[2]
    matrix = ((0.8, -0.2, -0.1), (-0.4, 1.2, 0.2), (0.0, 0.2, 0.6))
    session = make_session(tmp_path / "S", [[(replace(raw, camera_from_xyz=matrix), exposure)]])
    with pytest.raises(PartialError, match="colours are as the files say, but no view has a pose: only one"):
        calibrate(session, on_progress=unreported)
    assert read_calibration(session).cameras[0].camera_from_rec709 is not None


def test_poses_that_were_found_before_are_not_given_up(
    own_arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A calibration that fails to place anything does not replace one that did."""

    def fail(*given: object, **named: object) -> None:
        raise CalibrationError("No two views share enough of the scene.")

    monkeypatch.setattr("calib.poses.sfm.solve", fail)
    monkeypatch.setattr("calib.evidence.scene_views", lambda session: scene_of_two(session))
    before = read_calibration(own_arm)
    with pytest.raises(CalibrationError, match="no two views share"):
        calibrate(own_arm, on_progress=unreported)
    assert read_calibration(own_arm) == before


def scene_of_two(session: Session) -> list:
    from calib.data.views import scene_views

    return scene_views(session)[:2]


def test_a_session_without_images(tmp_path: Path) -> None:
    from datetime import UTC, datetime

    Session.create(
        tmp_path / "S", SessionRecord(name="S", created=datetime.now(UTC), origin="test", cameras=())
    )
    with pytest.raises(CalibrationError, match="has no shot of a scene"):
        calibrate(tmp_path / "S", on_progress=unreported)


def test_a_missing_image_is_named(tmp_path: Path) -> None:
    session = make_session(tmp_path / "S", [[(noise(i), None)] for i in range(2)])
    (session / "raw" / "0001" / "cam_0.jpg").unlink()
    with pytest.raises(InputError, match=r"cam_0\.jpg"):
        calibrate(session, on_progress=unreported)
    assert not (session / "calibration").exists()


def test_images_of_two_sizes_are_refused(tmp_path: Path) -> None:
    session = make_session(tmp_path / "S", [[(noise(0), None)], [(noise(1)[:64], None)]])
    with pytest.raises(InputError, match="differ in size"):
        calibrate(session, on_progress=unreported)
