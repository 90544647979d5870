"""calibration/report.html: what it says is what the records say, and nothing in them can break it."""

import base64
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.simulated import capture_simulated
from imaging.files import store
from imaging.files.photo import read_photo
from imaging.progress import unreported
from imaging.session.session import Session
from rig.report.charts.poses.rig_view import STEPS
from rig.report.pages.calibration import calibration_report
from rig.report.sections.shots import read_previews

from .pages import Page, assert_self_contained


def edited(path: Path, **changes: object) -> None:
    store.write_json(path, store.read_json(path) | changes)


def test_the_page_tells_what_the_records_say(toy: Path) -> None:
    path = calibration_report(toy)
    assert path == toy / "calibration" / "report.html"
    page = Page.read(path)
    assert_self_contained(page)
    for words in (
        "Simulated rig “toy”, seed 3: 2 cameras, 3 frames, 6 views, 18 exposures",
        "6 of 6 images with a pose",
        "0.210 px",
        "1/60 s f/4 ISO 100",
        "SIM-RAW-001",
        "64 × 48",
        "+0.031 ± 0.004 stops",
        "not tried: see why",
        "tangential distortion",
        "RAW is linear: brackets agree within 0.4 %.",
        "rig capture --sim toy --seed 3 --frames 3 toy",
        store.sha256(toy / "shots.jsonl"),
    ):
        assert words in page.text, words
    assert len(page.all("img")) == 6
    # Turntable, from above, residuals by view, a field for each camera, histogram, distortion, exposure
    # labels, vignetting.
    assert len(page.all("svg")) == STEPS + 8


def test_nothing_from_a_file_is_ever_markup(toy: Path) -> None:
    evil = "</style></title><script>alert('x')</script><img src=http://x onerror=alert(1)>&amp;\"'"
    session = store.read_json(toy / "session.json")
    for camera in session["cameras"]:
        camera |= {"model": evil, "make": evil, "serial": evil, "rig": evil}
    edited(toy / "session.json", cameras=session["cameras"], name=evil)
    plans = [json.loads(line) for line in (toy / "plans.jsonl").read_text().splitlines()]
    (toy / "plans.jsonl").write_text("".join(json.dumps(plan | {"reason": evil}) + "\n" for plan in plans))
    path = toy / "calibration" / "calibration.json"
    record = store.read_json(path)
    for camera in record["cameras"]:
        camera["response"]["evidence"] = evil
    for rung in record["rungs"]:
        rung |= {"name": evil, "reason": evil, "unit": evil}
    edited(
        path,
        cameras=record["cameras"],
        rungs=record["rungs"],
        unregistered=[f"0000/{evil}"],
        versions={evil: evil},
    )
    page = Page.read(calibration_report(toy))
    assert_self_contained(page)
    assert page.text.count("<script>alert('x')</script>") >= 10


def test_an_image_without_a_pose_is_named(toy: Path) -> None:
    path = toy / "calibration" / "calibration.json"
    record = store.read_json(path)
    edited(path, views=record["views"][1:], unregistered=["0000/cam0"])
    text = Page.read(calibration_report(toy)).text
    assert "5 of 6 images with a pose" in text
    assert "cam0: 2 of 3 images with a pose" in text
    assert "Without a pose: 0000/cam0" in text


@pytest.mark.parametrize(("error", "grade"), [(0.3, "pass"), (1.0, "warn"), (2.0, "fail")])
def test_the_verdict_holds_the_number_against_a_threshold(toy: Path, error: float, grade: str) -> None:
    edited(toy / "calibration" / "calibration.json", reprojection_px=error)
    html = calibration_report(toy).read_text(encoding="utf-8")
    line = next(line for line in html.splitlines() if "Mean reprojection error" in line and "badge" in line)
    assert f"badge {grade}" in line


def test_a_wrong_exposure_label_is_marked_with_its_ratio(toy: Path) -> None:
    path = toy / "calibration" / "calibration.json"
    labels = {shot.file: shot.reported.scale for shot in Session.open(toy).shots()}
    scale = {file: k * (1.25 if file.endswith("_2.dng") else 1.01) for file, k in labels.items()}
    edited(path, exposure_scale=scale)
    html = calibration_report(toy).read_text(encoding="utf-8")
    assert 'class="n mark">1.250<' in html
    assert 'class="n">1.010<' in html


def test_labels_that_are_taken_as_they_are_need_no_chart(toy: Path) -> None:
    labels = {shot.file: shot.reported.scale for shot in Session.open(toy).shots()}
    edited(toy / "calibration" / "calibration.json", exposure_scale=labels)
    page = Page.read(calibration_report(toy))
    assert "Exposure: label against estimate" not in page.text


def test_a_single_photograph_is_shown_as_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "ldr"
    capture_simulated("toy-ldr", folder, frames=1, bracket=(0.0,))
    session = Session.open(folder)
    previews = read_previews(session, unreported)
    assert not previews.merged
    shot = session.shots()[0]
    thumbnail = next(one for one in previews.thumbnails if one.camera == shot.camera)
    data = np.frombuffer(base64.b64decode(thumbnail.uri.split(",", 1)[1]), np.uint8)
    shown = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1].astype(float)
    codes = 255 * read_photo(session.file(shot)).pixels
    assert np.abs(shown - codes).mean() < 6  # merged and compressed it would be above 30


def test_shots_added_since_are_told(toy: Path) -> None:
    edited(toy / "calibration" / "calibration.json", shots_sha256="0" * 64)
    assert "run rig calibrate again" in Page.read(calibration_report(toy)).text


def test_a_damaged_file_is_named_and_the_page_still_made(toy: Path) -> None:
    (toy / "raw" / "0000" / "cam0_0.dng").write_bytes(b"II*\0 torn")
    text = Page.read(calibration_report(toy)).text
    assert "1 file cannot be read, the first is raw/0000/cam0_0.dng" in text


def test_a_calibration_without_a_colmap_model_still_has_its_page(toy: Path) -> None:
    shutil.rmtree(toy / "calibration" / "colmap")
    page = Page.read(calibration_report(toy))
    # No residuals: turntable, from above, distortion, exposure labels, vignetting.
    assert len(page.all("svg")) == STEPS + 4
    assert "Residual field" not in page.text


def test_clipped_highlights_ask_for_a_shorter_exposure(toy: Path) -> None:
    """Only the longest exposure of every bracket is left: the lamp is clipped in it."""
    lines = (toy / "shots.jsonl").read_text().splitlines(keepends=True)
    (toy / "shots.jsonl").write_text("".join(line for line in lines if json.loads(line)["step"] == 2))
    text = Page.read(calibration_report(toy)).text
    assert "add a shorter one to keep the highlights" in text
