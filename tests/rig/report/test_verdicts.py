"""Verdict on a calibration, its outliers, and advice for the next shots."""

from pathlib import Path

import numpy as np
import pytest

from calib.calibrate import calibrate
from calib.request import CalibrationRequest
from calib.sensor import metadata
from imaging.errors import InputError
from imaging.files import store
from imaging.session.calibration import (
    MOTION,
    CalibrationRecord,
    CameraCalibration,
    LensError,
    PoseError,
    Response,
    read_calibration,
)
from imaging.session.records import Rung
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from rig.__main__ import main
from rig.report.charts.residuals import CameraResiduals, Residuals
from rig.report.pages.calibration import calibration_report
from rig.report.sections.next_shots import next_shots
from rig.report.sections.verdicts import outliers, verdicts
from rig.terminal.calibration_result import poses_result

from .drawings import NOTHING, SENSOR, changed, with_sensor
from .pages import Page, assert_self_contained


def test_a_camera_and_a_view_that_miss_are_named(toy: Path) -> None:
    def residuals_of(miss: float) -> CameraResiduals:
        return CameraResiduals((64, 48), np.ones((5, 2)), np.full((5, 2), miss))

    record = read_calibration(toy)
    residuals = Residuals(
        {"a": residuals_of(0.1), "b": residuals_of(0.1), "c": residuals_of(1.0)},
        {ViewId(0, "a"): 0.1, ViewId(1, "a"): 0.1, ViewId(0, "b"): 0.9},
    )
    named = list(outliers(record, residuals))
    assert len(named) == 2
    assert named[0].startswith("Camera c misses scene points by 1.41 px rms, the others by 0.14 px")
    assert named[1].startswith("View 0000/b misses by 0.90 px rms")
    even = Residuals({"a": residuals_of(0.1), "b": residuals_of(0.1), "c": residuals_of(0.15)}, {})
    assert not list(outliers(record, even))


def test_a_view_that_is_less_sure_is_named_and_heads_its_table(toy: Path) -> None:
    record = read_calibration(toy)
    views = [v.model_copy(update={"error": PoseError(rotation=0.01, translation=0.1)}) for v in record.views]
    views[4] = views[4].model_copy(update={"error": PoseError(rotation=0.2, translation=0.3)})
    record = changed(record, views=tuple(views))
    name = str(views[4].id)
    assert any(name in line for line in outliers(record, NOTHING))
    store.write_json(toy / "calibration" / "calibration.json", record.model_dump(mode="json"))
    page = Page.read(calibration_report(toy))
    table = page.text[page.text.index("The least sure views") :]
    assert table.index(name) < min(table.index(str(v.id)) for i, v in enumerate(views) if i != 4)


def test_what_lacks_is_asked_for_and_nothing_else(toy: Path) -> None:
    session, record = Session.open(toy), with_sensor(toy, SENSOR)
    text = "\n".join(next_shots(session, record))
    for words in (
        "rig capture --darks",
        "rig capture --flats",
        "rig capture --board",
        "cam0, cam1 saturates",
    ):
        assert words in text
    for words in ("got no pose", "The gain of", "response of"):
        assert words not in text
    store.write_json(toy / "session.json", store.read_json(toy / "session.json") | {"origin": "import"})
    assert "rig capture" not in "\n".join(next_shots(Session.open(toy), record))
    lost = changed(record, views=record.views[1:], unregistered=(ViewId(0, "cam0"),))
    assert "0000/cam0 got no pose" in "\n".join(next_shots(session, lost))
    # Of photographs that were imported, the names that users know.
    lines = [shot.model_dump_json() for shot in session.shots()]
    lines += [
        shot.model_copy(update={"source": "photos/DSC_0434.JPG"}).model_dump_json()
        for shot in session.shots("scene")
        if (shot.frame, shot.camera) == (0, "cam0")
    ]
    (toy / "shots.jsonl").write_text("\n".join(lines) + "\n")
    assert "DSC_0434.JPG got no pose" in "\n".join(next_shots(session, lost))
    blind = changed(
        record,
        views=tuple(view for view in record.views if view.camera == "cam0"),
        unregistered=tuple(ViewId(frame, "cam1") for frame in range(3)),
    )
    assert "cam1 has no pose at all" in "\n".join(next_shots(session, blind))


def test_what_the_rig_alone_placed_is_told(toy: Path) -> None:
    record = read_calibration(toy)
    first = record.views[0].model_copy(update={"by_rig": True, "points": 0})
    record = changed(record, views=(first, *record.views[1:]))
    (asked,) = (words for words in next_shots(Session.open(toy), record) if "0000/cam0" in words)
    assert "its pose is the rig's" in asked
    graded = {verdict.text.split(":")[0]: verdict for verdict in verdicts(record, NOTHING)}
    assert graded["cam0"].grade == "warn"
    assert "1 of them by the rig alone, the others: each from" in graded["cam0"].text
    assert "rig alone" not in graded["cam1"].text


def test_what_the_rig_placed_because_others_contradicted_it_is_not_called_unrecognised(toy: Path) -> None:
    record = read_calibration(toy)
    first = record.views[0].model_copy(update={"by_rig": True, "points": 0})
    record = changed(record, views=(first, *record.views[1:]), contradicted=(ViewId(0, "cam0"),))
    (asked,) = (words for words in next_shots(Session.open(toy), record) if "0000/cam0" in words)
    assert asked.startswith("0000/cam0 contradicts other views about where it stands")
    outcome = poses_result(toy, record)
    (line,) = (line for line in outcome.lines if "0000/cam0" in line)
    assert line.endswith("0000/cam0 contradicts other images about where it stands: its pose is the rig's")
    assert outcome.missing is None


@pytest.mark.parametrize(
    "name",
    ["pose_hanging", "pose_lit_differently", "pose_loose", "pose_moving", "pose_unconfirmed", "raw_curve"],
)
def test_doubts_are_told_everywhere(toy: Path, name: str) -> None:
    record = read_calibration(toy)
    record = changed(record, rungs=(*record.rungs, Rung(name=name, taken=True, reason="why they are")))
    assert "Why they are." in list(next_shots(Session.open(toy), record))
    outcome = poses_result(toy, record)
    assert f"{toy}: why they are" in outcome.lines
    assert outcome.data["doubts"] == ["why they are"]


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("exposure_each_photograph", "exposure"),
        ("white_balance_each_photograph", "white_balance"),
        ("white_balance", "white_balance"),
        ("vignetting", "falloff"),
        ("vignetting_each_camera", "falloff"),
        ("camera_gain", "gain"),
    ],
)
def test_each_part_of_light_that_was_taken_is_named_with_how_to_leave_it_out(
    toy: Path, name: str, part: str
) -> None:
    record = read_calibration(toy)
    for taken in (True, False):
        with_rung = changed(record, rungs=(Rung(name=name, taken=taken, reason="they differ by 7 %"),))
        lines = [line for line in poses_result(toy, with_rung).lines if "they differ by 7 %" in line]
        assert len(lines) == taken
        assert all(line.endswith(f"(--without {part} leaves it out)") for line in lines)


def test_what_points_ask_for_against_the_files_is_named_with_how_to_leave_it_out(toy: Path) -> None:
    record = read_calibration(toy)
    rungs = tuple(
        Rung(name=f"{part}_each_photograph", taken=False, reason="the files say so; points differ by 7 %")
        for part in ("exposure", "white_balance")
    )
    asked = record.views[0].model_copy(update={"exposure_asked": 1.07})
    for first, expected in ((record.views[0], []), (asked, ["exposure"])):
        lines = poses_result(toy, changed(record, rungs=rungs, views=(first, *record.views[1:]))).lines
        named = [line.split(": ")[1].split(" of")[0] for line in lines if "points differ by 7 %" in line]
        assert named == expected


def test_parts_to_leave_out_that_are_none_or_need_poses_are_refused(toy: Path) -> None:
    with pytest.raises(InputError, match="there is no part 'colour' to leave out: choose from exposure, "):
        calibrate(toy, CalibrationRequest(without=["colour"]))  # type: ignore[list-item]
    with pytest.raises(InputError, match="--without leaves out what scene points show, not the response"):
        calibrate(toy, CalibrationRequest(only="response", without=["falloff"]))


def test_the_command_hands_on_the_parts_to_leave_out(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def calibrated(session: Path, request: CalibrationRequest, **options: object) -> CalibrationRecord:
        asked.append(request.without)
        return read_calibration(session)

    monkeypatch.setattr("calib.calibrate.calibrate", calibrated)
    assert main(["calibrate", str(toy), "--without", "white_balance", "--without", "falloff"]) == 0
    assert asked == [["white_balance", "falloff"]]
    assert main(["calibrate", str(toy), "--without", "colour"]) == 2


def test_how_cameras_that_see_nothing_in_common_stand_is_told_and_what_motion_lacks_is_asked_for(
    toy: Path,
) -> None:
    record = read_calibration(toy)
    for taken in (True, False):
        with_rung = changed(
            record, rungs=(*record.rungs, Rung(name=MOTION, taken=taken, reason="the others moved"))
        )
        assert f"{toy}: the others moved" in poses_result(toy, with_rung).lines
        assert ("The others moved." in list(next_shots(Session.open(toy), with_rung))) == (not taken)


def test_a_board_that_stayed_in_the_middle_is_sent_to_the_corners(toy: Path) -> None:
    error = dict.fromkeys(("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"), 0.1)
    grid = np.full((6, 9), 0.1)
    grid[0, 8] = 0.9
    record = read_calibration(toy)
    board = {
        "board": {"columns": 7, "rows": 5, "square": 0.1, "marker": 0.08, "dictionary": "DICT_4X4_50"},
        "printed": "as OpenCV prints it",
        "frames": 20,
        "views": 30,
        "corners": 500,
        "rms_px": 0.1,
        "outliers": ["the board misses by 3.00 px in view 0007/cam0, 0.10 px in the others."],
    }
    cameras = [
        camera.model_copy(
            update={"lens_error": LensError.model_validate({**error, "projection": grid.tolist()})}
        )
        for camera in record.cameras[:1]
    ]
    record = CalibrationRecord.model_validate(
        changed(record, cameras=(*cameras, *record.cameras[1:])).model_dump() | {"board": board, "unit": "m"}
    )
    text = "\n".join(next_shots(Session.open(toy), record))
    assert "corners of cam0 (upper right known to 0.90 px, the middle to 0.10 px)" in text
    assert "--board" not in text
    assert any("0007/cam0" in line for line in outliers(record, NOTHING))
    store.write_json(toy / "calibration" / "calibration.json", record.model_dump(mode="json"))
    page = Page.read(calibration_report(toy))
    assert_self_contained(page)
    assert "Projection uncertainty" in page.text
    assert (
        "Board: 500 corners in 30 views fit to 0.100 px rms (good below 0.5, doubtful above 1.0 px)"
        in page.text
    )


def test_a_long_list_of_images_without_a_pose_is_cut_short(toy: Path) -> None:
    record = read_calibration(toy)
    lost = tuple(ViewId(frame, "cam0") for frame in range(100, 140))
    store.write_json(
        toy / "calibration" / "calibration.json", changed(record, unregistered=lost).model_dump(mode="json")
    )
    text = Page.read(calibration_report(toy)).text
    assert "0123/cam0 and 16 more." in text
    assert "cam0: 3 of 43 images with a pose" in text


def test_of_a_camera_whose_response_is_all_that_was_measured_it_is_said() -> None:
    response = Response(kind="curve", evidence="", residual=0.02)
    camera = CameraCalibration(name="a", serial="1", response=response)
    record = CalibrationRecord(
        created="2026-01-01T00:00:00Z", versions={}, shots_sha256="", cameras=(camera,), views=(),
        unregistered=(ViewId(0, "a"),), exposure_scale={},
    )  # fmt: skip
    _, verdict = verdicts(record, NOTHING)
    assert verdict.text == "a: response measured, with overlapping exposures agreeing to 2 %"


def test_of_photographs_no_sensor_is_spoken() -> None:
    assert metadata.rungs({}) == ()
