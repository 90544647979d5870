"""Residuals and lenses as the calibration's page draws them."""

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from imaging.optics.lens import Lens, fisheye_angle
from imaging.session.calibration import read_calibration
from imaging.session.view_id import ViewId
from rig.report.charts.lens_charts import field, heat_map, lens_topic
from rig.report.charts.residuals import CameraResiduals, Residuals, read_residuals
from rig.report.sections.calibrated import _across
from tests.rig.conftest import MISS

from .drawings import drawings, of_class


def test_residuals_are_seen_less_projected(toy: Path) -> None:
    residuals = read_residuals(toy / "calibration" / "colmap")
    assert sorted(residuals.cameras) == ["cam0", "cam1"]
    assert len(residuals.views) == 6
    for of_camera in residuals.cameras.values():
        assert of_camera.size == (64, 48)
        assert of_camera.rms == pytest.approx(math.hypot(*MISS), rel=1e-6)
        right = of_camera.observed[:, 0] - of_camera.miss[:, 0] > of_camera.size[0] / 2
        np.testing.assert_allclose(
            of_camera.miss[right], np.broadcast_to(MISS, of_camera.miss[right].shape), atol=1e-6
        )
        left = of_camera.miss[~right]
        assert abs(left.mean(0)[0]) < 0.1 * MISS[0]
    assert residuals.views[ViewId(0, "cam0")] == pytest.approx(math.hypot(*MISS), rel=1e-6)


def test_without_a_model_there_are_no_residuals(tmp_path: Path) -> None:
    residuals = read_residuals(tmp_path / "nothing")
    assert not residuals.cameras
    assert not residuals.views


def test_the_field_shows_a_pattern_and_keeps_noise_faint() -> None:
    """Left half noise of 0.2 px, right half shifted by 0.1 px to the right."""
    rng = np.random.default_rng(1)
    places = rng.uniform((0, 0), (120, 80), (20_000, 2))
    miss = rng.normal(0, 0.2, places.shape) + np.where(places[:, :1] > 60, (0.1, 0.0), (0.0, 0.0))
    (drawing,) = drawings(field("<cam>", CameraResiduals((120, 80), places, miss)))
    arrows = of_class(drawing, "arrow")
    assert len(arrows) == 12 * 8
    for arrow in arrows:
        x, y, tip_x, tip_y = (float(v) for v in re.findall(r"-?[\d.]+", arrow.get("d"))[:4])
        if x > 150:
            assert "faint" not in arrow.get("class")
            assert tip_x - x > 3 * abs(tip_y - y) - 8
    faint = [arrow for arrow in arrows if "faint" in arrow.get("class")]
    assert len(faint) > 0.75 * 48


def test_arrows_are_magnified_by_what_is_told() -> None:
    places = np.stack(np.meshgrid(np.arange(0.5, 120), np.arange(0.5, 80)), -1).reshape(-1, 2)
    markup = field("cam", CameraResiduals((120, 80), places, np.broadcast_to((0.03, 0.0), places.shape)))
    factor = float(re.search(r"arrows × ([\d,]+)", markup)[1].replace(",", ""))
    arrow = of_class(drawings(markup)[0], "arrow")[0]
    x, _, tip_x, _ = (float(v) for v in re.findall(r"-?[\d.]+", arrow.get("d"))[:4])
    assert tip_x - x == pytest.approx(0.03 * factor * 300 / 120, abs=0.11)
    assert factor == 500  # a cell and a half, 15 px


def test_points_that_miss_nothing_have_a_field_too() -> None:
    places = np.full((10, 2), 5.0)
    (drawing,) = drawings(field("cam", CameraResiduals((10, 10), places, np.zeros((10, 2)))))
    assert "nan" not in ElementTree.tostring(drawing, encoding="unicode")


def test_the_map_writes_its_numbers_where_they_hold(toy: Path) -> None:
    lens = read_calibration(toy).cameras[0].lens
    (drawing,) = drawings(heat_map("cam", np.array([[0.11, 0.22], [0.33, 0.44]]), lens, 0.44))
    texts = {part.text: (float(part.get("x")), float(part.get("y"))) for part in drawing.iter() if part.text}
    assert texts["0.11"][0] < texts["0.22"][0]
    assert texts["0.11"][1] < texts["0.33"][1]
    shades = [float(cell.get("fill-opacity")) for cell in of_class(drawing, "cell")]
    assert shades == sorted(shades)


def test_a_fisheye_is_told_by_its_own_terms_and_its_angle(toy: Path) -> None:
    """Beside a lens of radial terms: each has dashes where it has no such term."""
    record = read_calibration(toy)
    before = record.cameras[0].lens
    wide = Lens(
        model="OPENCV_FISHEYE", width=before.width, height=before.height, fx=0.58 * before.width,
        fy=0.58 * before.width, cx=before.cx, cy=before.cy, k1=0.03, k2=-0.01, k3=0.004, k4=-0.002,
    )  # fmt: skip
    camera = record.cameras[0].model_copy(update={"lens": wide, "lens_error": None})
    mixed = record.model_copy(update={"cameras": (camera, *record.cameras[1:])})
    topic = lens_topic(mixed, Residuals({}, {}))
    table = next(table for table in topic.tables if table.heading == "Terms of the lenses")
    assert table.columns[-4:] == ("#p1", "#p2", "#k3", "#k4")
    first, second = table.rows
    assert first[1] == "OPENCV_FISHEYE"
    assert first[-4:-2] == ("–", "–")
    assert float(first[-2].split()[0]) == 0.004
    assert second[-2:] == ("–", "–")
    (drawing,) = (figure for figure in topic.figures if figure.heading == "Distortion")
    assert "nan" not in drawing.drawing
    half = fisheye_angle(np.array(wide.width / 2 / wide.fx), wide.terms[4:])
    assert _across(wide) == pytest.approx(2 * math.degrees(float(half)))
    assert 95 < _across(wide) < 100
