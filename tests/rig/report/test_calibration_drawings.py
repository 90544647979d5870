"""Calibration's page as a whole: values, ladders, and sessions that lack much."""

import math
import re
import shutil
from pathlib import Path

import pytest

from imaging.files import store
from imaging.session.calibration import read_calibration
from imaging.session.records import Rung
from imaging.session.session import Session
from rig.report.charts.chart import Series, chart
from rig.report.charts.topic import plus_minus
from rig.report.pages.calibration import calibration_report
from rig.report.sections.calibrated import calibrated

from .drawings import changed, drawings, of_class
from .pages import Page, assert_self_contained


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (326.7191, 0.6545, "326.72 ± 0.65"),
        (-0.0609, 0.01055, "−0.061 ± 0.011"),
        (0.3, 0.0996, "0.30 ± 0.10"),
        (-1e-5, 0.01, "0.000 ± 0.010"),
        (12345.0, 123.0, "12345 ± 123"),
        (5.0, None, "5"),
        (math.nan, 0.1, "not determined"),
    ],
)
def test_a_value_has_as_many_decimals_as_its_error(value: float, sigma: float | None, text: str) -> None:
    assert plus_minus(value, sigma) == text


def test_rungs_are_grouped_by_topic_and_those_of_a_board_told_apart(toy: Path) -> None:
    rungs = (
        Rung(
            name="lens_radial_2",
            taken=True,
            unit="px^2 of held-out corners, over frames of the board",
            reason="b",
        ),
        Rung(name="sensor_noise", taken=True, reason="n"),
        Rung(name="lens_radial_2", taken=False, reason="s"),
        Rung(name="something_new", taken=False, reason="x"),
    )
    record = changed(read_calibration(toy), rungs=rungs)
    groups = calibrated(Session.open(toy), record, stale=False).rungs
    assert [(group.title, [row.name for row in group.rows]) for group in groups] == [
        ("Sensors", ["sensor noise"]),
        ("Lenses", ["lens radial 2, board", "lens radial 2"]),
        ("Other", ["something new"]),
    ]


def test_a_band_is_drawn_around_its_line() -> None:
    markup = chart("t", [Series("", [0, 1], [5, 5], margin=[5, 5])], "x", "y")
    band = of_class(drawings(markup)[0], "band")[0].get("d")
    heights = {float(y) for y in re.findall(r" ([\d.]+)", band)}
    line = of_class(drawings(markup)[0], "line")[0].get("d")
    middle = {float(y) for y in re.findall(r" ([\d.]+)", line)}
    assert sum(heights) / 2 == pytest.approx(next(iter(middle)), abs=0.1)


def test_a_session_without_a_scene_is_told_by_what_it_has(toy: Path) -> None:
    """All shots become darks: no bracket, no views to ask more of."""
    shutil.rmtree(toy / "calibration" / "colmap")
    lines = (toy / "shots.jsonl").read_text().replace('"kind": "scene"', '"kind": "dark"')
    (toy / "shots.jsonl").write_text(lines)
    record = read_calibration(toy).model_copy(update={"views": (), "points": 0, "reprojection_px": None})
    store.write_json(toy / "calibration" / "calibration.json", record.model_dump(mode="json"))
    page = Page.read(calibration_report(toy))
    assert_self_contained(page)
    assert "0 exposures; 18 darks" in page.text
    for words in ("can hardly make a scene", "Bracket", "There are no darks", "No image has a pose:"):
        assert words not in page.text


def test_a_calibration_of_nothing_has_a_page(toy: Path) -> None:
    shutil.rmtree(toy / "calibration" / "colmap")
    record = read_calibration(toy)
    cameras = [
        {"name": camera.name, "serial": "", "response": {"kind": "linear", "evidence": "none"}}
        for camera in record.cameras[:1]
    ]
    blank = record.model_dump(mode="json") | {
        "cameras": cameras, "views": [], "unregistered": [], "points": 0, "reprojection_px": None, "rungs": []
    }  # fmt: skip
    store.write_json(toy / "calibration" / "calibration.json", blank)
    page = Page.read(calibration_report(toy))
    assert_self_contained(page)
    assert "cam0: nothing was measured of it" in page.text
    assert not re.search(r"\bnan\b", page.html, re.IGNORECASE)


def test_poses_that_were_not_asked_for_are_not_missed(toy: Path) -> None:
    """Act as after `rig calibrate --only sensor`: nothing was to be placed."""
    shutil.rmtree(toy / "calibration" / "colmap")
    record = changed(read_calibration(toy), views=(), points=0, reprojection_px=None)
    store.write_json(toy / "calibration" / "calibration.json", record.model_dump(mode="json"))
    text = Page.read(calibration_report(toy)).text
    assert "Exposures and cameras; poses were not asked for." in text
    for words in ("ithout a pose", "No image has a pose", "no image has a pose", "images with a pose"):
        assert words not in text
