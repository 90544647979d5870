"""Drawings and sentences of a calibration: that they say what the records and the COLMAP model hold."""

import math
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from imaging import store
from imaging.calibration import CalibrationRecord, LensError, PoseError, read_calibration
from imaging.records import Rung
from imaging.sensor import Defect, Measured, SensorCalibration
from imaging.session import Session
from rig.report.calibrated import calibrated
from rig.report.calibration_page import calibration_report
from rig.report.chart import Series, chart
from rig.report.lens_charts import field, heat_map
from rig.report.next_shots import next_shots
from rig.report.residuals import CameraResiduals, Residuals, read_residuals
from rig.report.rig_view import STEPS, turntable
from rig.report.sensor_charts import sensor_topic
from rig.report.topic import plus_minus
from rig.report.verdicts import outliers, verdicts

from .conftest import MISS
from .pages import Page, assert_self_contained

NOTHING = Residuals({}, {})


def quiet(message: str, done: int, total: int) -> None:
    """No progress."""


def drawings(markup: str) -> list[ElementTree.Element]:
    return [ElementTree.fromstring(text) for text in re.findall(r"<svg.*?</svg>", markup, re.DOTALL)]


def of_class(drawing: ElementTree.Element, kind: str) -> list[ElementTree.Element]:
    return [part for part in drawing.iter() if kind in part.get("class", "").split()]


def changed(record: CalibrationRecord, **update: object) -> CalibrationRecord:
    """The same with other fields, checked."""
    return CalibrationRecord.model_validate(record.model_copy(update=update).model_dump())


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


def test_residuals_are_seen_less_projected(toy: Path) -> None:
    found = read_residuals(toy / "calibration" / "colmap")
    assert sorted(found.cameras) == ["cam0", "cam1"]
    assert len(found.views) == 6
    for own in found.cameras.values():
        assert own.size == (64, 48)
        assert own.rms == pytest.approx(math.hypot(*MISS), rel=1e-6)
        right = own.seen[:, 0] - own.miss[:, 0] > own.size[0] / 2
        np.testing.assert_allclose(own.miss[right], np.broadcast_to(MISS, own.miss[right].shape), atol=1e-6)
        left = own.miss[~right]
        assert abs(left.mean(0)[0]) < 0.1 * MISS[0]
    assert found.views["cam0", 0] == pytest.approx(math.hypot(*MISS), rel=1e-6)


def test_without_a_model_there_are_no_residuals(tmp_path: Path) -> None:
    found = read_residuals(tmp_path / "nothing")
    assert not found.cameras
    assert not found.views


def test_the_field_shows_a_pattern_and_keeps_noise_faint() -> None:
    """Left half noise of 0.2 px, right half shifted by 0.1 px to the right."""
    rng = np.random.default_rng(1)
    seen = rng.uniform((0, 0), (120, 80), (20_000, 2))
    miss = rng.normal(0, 0.2, seen.shape) + np.where(seen[:, :1] > 60, (0.1, 0.0), (0.0, 0.0))
    (drawing,) = drawings(field("<cam>", CameraResiduals((120, 80), seen, miss)))
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
    seen = np.stack(np.meshgrid(np.arange(0.5, 120), np.arange(0.5, 80)), -1).reshape(-1, 2)
    markup = field("cam", CameraResiduals((120, 80), seen, np.broadcast_to((0.03, 0.0), seen.shape)))
    factor = float(re.search(r"arrows × ([\d,]+)", markup)[1].replace(",", ""))
    arrow = of_class(drawings(markup)[0], "arrow")[0]
    x, _, tip_x, _ = (float(v) for v in re.findall(r"-?[\d.]+", arrow.get("d"))[:4])
    assert tip_x - x == pytest.approx(0.03 * factor * 300 / 120, abs=0.11)
    assert factor == 500  # a cell and a half, 15 px


def test_points_that_miss_nothing_have_a_field_too() -> None:
    seen = np.full((10, 2), 5.0)
    (drawing,) = drawings(field("cam", CameraResiduals((10, 10), seen, np.zeros((10, 2)))))
    assert "nan" not in ElementTree.tostring(drawing, encoding="unicode")


def test_the_map_writes_its_numbers_where_they_hold(toy: Path) -> None:
    lens = read_calibration(toy).cameras[0].lens
    (drawing,) = drawings(heat_map("cam", [[0.11, 0.22], [0.33, 0.44]], lens, 0.44))
    texts = {part.text: (float(part.get("x")), float(part.get("y"))) for part in drawing.iter() if part.text}
    assert texts["0.11"][0] < texts["0.22"][0]
    assert texts["0.11"][1] < texts["0.33"][1]
    shades = [float(cell.get("fill-opacity")) for cell in of_class(drawing, "cell")]
    assert shades == sorted(shades)


def test_the_turntable_is_one_scene_from_all_sides(toy: Path) -> None:
    record = read_calibration(toy)
    poses = {(view.frame, view.camera): view.cam_from_world.matrix() for view in record.views}
    lenses = {camera.name: camera.lens for camera in record.cameras}
    points = np.random.default_rng(0).normal(0, 1, (50, 3))
    markup = turntable(poses, lenses, points, metric=True)
    shown = drawings(markup)
    assert len(shown) == STEPS == markup.count('type="radio"')
    for drawing in shown:
        assert len(of_class(drawing, "camera")) == 6
        assert [part.text for part in of_class(drawing, "name")] == ["cam0", "cam1"]
        numbers = [float(v) for path in drawing.iter() for v in re.findall(r"-?[\d.]+", path.get("d") or "")]
        assert all(math.isfinite(v) for v in numbers)

    # Half a turn on, left is right: cameras that are apart across the page swap sides.
    across = [float(of_class(d, "name")[0].get("x")) - float(of_class(d, "name")[1].get("x")) for d in shown]
    assert across[0] * across[STEPS // 2] < 0
    assert across[0] == pytest.approx(-across[STEPS // 2], abs=2.1)
    assert "lengths are relative" in turntable(poses, lenses, points, metric=False)


def test_every_button_of_the_turntable_shows_its_drawing(toy: Path) -> None:
    html = calibration_report(toy, quiet).read_text(encoding="utf-8")
    rules = re.findall(r"input:nth-of-type\((\d+)\):checked ~ svg:nth-of-type\((\d+)\)", html)
    assert rules == [(str(turn), str(turn)) for turn in range(1, STEPS + 1)]
    (table,) = re.findall(r'<div class="turn">(.*?)</div>', html, re.DOTALL)
    assert re.findall(r"<(input|svg) ", table) == ["input"] * STEPS + ["svg"] * STEPS
    assert table.count(" checked") == 1


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


def test_a_single_view_without_points_can_be_turned() -> None:
    markup = turntable({(0, "cam"): np.eye(4)}, {}, np.zeros((0, 3)), metric=False)
    assert len(drawings(markup)) == STEPS
    assert "nan" not in markup


def test_many_views_are_thinned_and_the_drawing_stays_small() -> None:
    rng = np.random.default_rng(0)
    poses = {}
    for index in range(1000):
        pose = np.eye(4)
        pose[:3, 3] = rng.normal(0, 3, 3)
        poses[index // 30, f"cam{index % 30}"] = pose
    markup = turntable(poses, {}, rng.normal(0, 5, (100_000, 3)), metric=True)
    assert len(markup) < 2e6
    assert len(of_class(drawings(markup)[0], "camera")) == 200


SENSOR = SensorCalibration(
    iso=100.0,
    gain=Measured(value=0.4, sigma=0.003, source="flats"),
    read_noise=Measured(value=3.0, sigma=0.04, source="darks and flats"),
    nonlinearity=Measured(value=0.02, sigma=0.001, source="flats"),
    linear=False,
    defects=(Defect(x=1, y=2, kind="hot"), Defect(x=3, y=2, kind="hot")),
    transfer=((-0.01, 1.5), (100.0, 41.5), (1000.0, 401.5)),
)


def with_sensor(toy: Path, sensor: SensorCalibration) -> CalibrationRecord:
    record = read_calibration(toy)
    cameras = [camera.model_copy(update={"sensors": (sensor,)}) for camera in record.cameras]
    return changed(record, cameras=tuple(cameras))


def test_photon_transfer_goes_through_the_points(toy: Path) -> None:
    topic = sensor_topic(with_sensor(toy, SENSOR))
    figure = topic.figures[0]
    assert "Dots: measured" in figure.explanation
    drawing = drawings(figure.drawing)[0]
    dots = re.findall(r"M([\d.]+) ([\d.]+)h0", of_class(drawing, "dots")[0].get("d"))
    assert len(dots) == 3
    line = [
        (float(x), float(y))
        for x, y in re.findall(r"([\d.]+) ([\d.]+)", of_class(drawing, "line")[0].get("d"))
    ]
    for x, y in dots:
        assert np.interp(float(x), *np.array(line).T) == pytest.approx(float(y), abs=1.5)


def test_points_off_the_photon_transfer_line_are_drawn_off_it(toy: Path) -> None:
    """A variance of 110 % of the fitted one stands 10 % above the line, one on it at zero."""
    fitted = 0.4 * 100 + (0.4 * 3) ** 2 + 1 / 12
    sensor = SENSOR.model_copy(update={"transfer": ((100.0, fitted), (1000.0, 1.1 * (fitted + 360)))})
    figure = sensor_topic(with_sensor(toy, sensor)).figures[1]
    drawing = drawings(figure.drawing)[0]
    dots = re.findall(r"M([\d.]+) ([\d.]+)h0", of_class(drawing, "dots")[0].get("d"))
    (level,) = of_class(drawing, "level")
    zero = float(re.match(r"M\d+ ([\d.]+)", level.get("d"))[1])
    ticks = {part.text: float(part.get("y")) - 4 for part in of_class(drawing, "ytick")}
    assert float(dots[0][1]) == pytest.approx(zero, abs=0.2)
    assert float(dots[1][1]) == pytest.approx(ticks["10"], abs=0.2)


def test_what_a_sensor_does_not_tell_is_not_determined(toy: Path) -> None:
    noise, levels = sensor_topic(with_sensor(toy, SENSOR)).tables
    assert noise.rows[0][2:4] == ("0.4000 ± 0.0030", "3.000 ± 0.040")
    assert noise.rows[0][4:8] == ("not determined",) * 4
    assert levels.rows[0][-2:] == ("2.00 ± 0.10", "2 hot")
    blank = sensor_topic(with_sensor(toy, SensorCalibration()))
    assert not blank.figures
    assert blank.tables[1].rows[0][-1] == "not looked for"


def test_a_camera_whose_raw_bends_is_told_and_warned_of_if_much(toy: Path) -> None:
    line = next(v for v in verdicts(with_sensor(toy, SENSOR), NOTHING) if v.text.startswith("cam0"))
    assert line.grade == "pass"
    assert "RAW bends by 2.0 % at white and is straightened (good below 5 %)" in line.text
    worse = SENSOR.model_copy(update={"nonlinearity": Measured(value=0.2, sigma=0.01, source="flats")})
    line = next(v for v in verdicts(with_sensor(toy, worse), NOTHING) if v.text.startswith("cam0"))
    assert line.grade == "warn"
    assert "sensor gain known to 0.75 % (good below 5 %)" in line.text


def test_a_camera_and_a_view_that_miss_are_named(toy: Path) -> None:
    def own(miss: float) -> CameraResiduals:
        return CameraResiduals((64, 48), np.ones((5, 2)), np.full((5, 2), miss))

    record = read_calibration(toy)
    found = Residuals(
        {"a": own(0.1), "b": own(0.1), "c": own(1.0)}, {("a", 0): 0.1, ("a", 1): 0.1, ("b", 0): 0.9}
    )
    named = list(outliers(record, found))
    assert len(named) == 2
    assert named[0].startswith("Camera c misses scene points by 1.41 px rms, the others by 0.14 px")
    assert named[1].startswith("View b/0000 misses by 0.90 px rms")
    even = Residuals({"a": own(0.1), "b": own(0.1), "c": own(0.15)}, {})
    assert not list(outliers(record, even))


def test_a_view_that_is_less_sure_is_named_and_heads_its_table(toy: Path) -> None:
    record = read_calibration(toy)
    views = [v.model_copy(update={"error": PoseError(rotation=0.01, translation=0.1)}) for v in record.views]
    views[4] = views[4].model_copy(update={"error": PoseError(rotation=0.2, translation=0.3)})
    record = changed(record, views=tuple(views))
    name = f"{views[4].camera}/{views[4].frame:04d}"
    assert any(name in line for line in outliers(record, NOTHING))
    store.write_json(toy / "calibration" / "calibration.json", record.model_dump(mode="json"))
    page = Page.read(calibration_report(toy, quiet))
    table = page.text[page.text.index("The least sure views") :]
    assert table.index(name) < min(
        table.index(f"{v.camera}/{v.frame:04d}") for i, v in enumerate(views) if i != 4
    )


def test_what_lacks_is_asked_for_and_nothing_else(toy: Path) -> None:
    session, record = Session.open(toy), with_sensor(toy, SENSOR)
    told = "\n".join(next_shots(session, record))
    for words in (
        "rig capture --darks",
        "rig capture --flats",
        "rig capture --board",
        "cam0, cam1 saturates",
    ):
        assert words in told
    for words in ("got no pose", "The gain of", "response of"):
        assert words not in told
    store.write_json(toy / "session.json", store.read_json(toy / "session.json") | {"origin": "import"})
    assert "rig capture" not in "\n".join(next_shots(Session.open(toy), record))
    lost = changed(record, views=record.views[1:], unregistered=("cam0/0000",))
    assert "cam0/0000 got no pose" in "\n".join(next_shots(session, lost))
    blind = changed(
        record,
        views=tuple(view for view in record.views if view.camera == "cam0"),
        unregistered=("cam1/0000", "cam1/0001", "cam1/0002"),
    )
    assert "cam1 has no pose at all" in "\n".join(next_shots(session, blind))


def test_what_the_rig_alone_placed_is_told(toy: Path) -> None:
    record = read_calibration(toy)
    first = record.views[0].model_copy(update={"by_rig": True, "points": 0})
    record = changed(record, views=(first, *record.views[1:]))
    (asked,) = (words for words in next_shots(Session.open(toy), record) if "cam0/0000" in words)
    assert "its pose is the rig's" in asked
    graded = {verdict.text.split(":")[0]: verdict for verdict in verdicts(record, NOTHING)}
    assert graded["cam0"].grade == "warn"
    assert "1 of them by the rig alone, the others: each from" in graded["cam0"].text
    assert "rig alone" not in graded["cam1"].text


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
        "outliers": ["the board misses by 3.00 px in view cam0/0007, 0.10 px in the others."],
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
    told = "\n".join(next_shots(Session.open(toy), record))
    assert "corners of cam0 (upper right known to 0.90 px, the middle to 0.10)" in told
    assert "--board" not in told
    assert any("cam0/0007" in line for line in outliers(record, NOTHING))
    store.write_json(toy / "calibration" / "calibration.json", record.model_dump(mode="json"))
    page = Page.read(calibration_report(toy, quiet))
    assert_self_contained(page)
    assert "Projection uncertainty" in page.text
    assert (
        "Board: 500 corners in 30 views fit to 0.100 px rms (good below 0.5, doubtful above 1.0 px)"
        in page.text
    )


def test_a_band_is_drawn_around_its_line() -> None:
    markup = chart("t", [Series("", [0, 1], [5, 5], margin=[5, 5])], "x", "y")
    band = of_class(drawings(markup)[0], "band")[0].get("d")
    heights = {float(y) for y in re.findall(r" ([\d.]+)", band)}
    line = of_class(drawings(markup)[0], "line")[0].get("d")
    middle = {float(y) for y in re.findall(r" ([\d.]+)", line)}
    assert sum(heights) / 2 == pytest.approx(next(iter(middle)), abs=0.1)


def test_a_long_list_of_images_without_a_pose_is_cut_short(toy: Path) -> None:
    record = read_calibration(toy)
    lost = tuple(f"cam0/{frame:04d}" for frame in range(100, 140))
    store.write_json(
        toy / "calibration" / "calibration.json", changed(record, unregistered=lost).model_dump(mode="json")
    )
    text = Page.read(calibration_report(toy, quiet)).text
    assert "cam0/0123 and 16 more." in text
    assert "cam0: 3 of 43 images with a pose" in text


def test_a_session_without_a_scene_is_told_by_what_it_has(toy: Path) -> None:
    """All shots become darks: no bracket, no views to ask more of."""
    shutil.rmtree(toy / "calibration" / "colmap")
    lines = (toy / "shots.jsonl").read_text().replace('"kind": "scene"', '"kind": "dark"')
    (toy / "shots.jsonl").write_text(lines)
    record = read_calibration(toy).model_copy(update={"views": (), "points": 0, "reprojection_px": None})
    store.write_json(toy / "calibration" / "calibration.json", record.model_dump(mode="json"))
    page = Page.read(calibration_report(toy, quiet))
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
    page = Page.read(calibration_report(toy, quiet))
    assert_self_contained(page)
    assert "cam0: nothing was measured of it" in page.text
    assert not re.search(r"\bnan\b", page.html, re.IGNORECASE)
