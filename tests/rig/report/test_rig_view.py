"""The rig and the scene as a turntable, and the board before the rig."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from imaging.optics.pose import Pose
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.calibration_evidence import BoardEvidence, BoardPlace
from imaging.session.records import Board
from imaging.session.view_id import ViewId
from rig.report.charts.poses.board_view import board_figures
from rig.report.charts.poses.pose_charts import pose_topic
from rig.report.charts.poses.rig_view import STEPS, turntable
from rig.report.pages.calibration import calibration_report

from .drawings import NOTHING, changed, drawings, of_class


def test_the_turntable_is_one_scene_from_all_sides(toy: Path) -> None:
    record = read_calibration(toy)
    poses = {view.id: view.cam_from_world.matrix() for view in record.views}
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
    html = calibration_report(toy).read_text(encoding="utf-8")
    rules = re.findall(r"input:nth-of-type\((\d+)\):checked ~ svg:nth-of-type\((\d+)\)", html)
    assert rules == [(str(turn), str(turn)) for turn in range(1, STEPS + 1)]
    (table,) = re.findall(r'<div class="turn"[^>]*>(.*?)</div>', html, re.DOTALL)
    assert re.findall(r"<(input|svg) ", table) == ["input"] * STEPS + ["svg"] * STEPS
    assert table.count(" checked") == 1


def test_the_buttons_of_the_turntable_say_what_they_are_for(toy: Path) -> None:
    html = calibration_report(toy).read_text()
    (table,) = re.findall(r'<div class="turn".*?</div>', html, re.DOTALL)
    assert 'role="radiogroup" aria-label="Direction' in table
    assert "Seen from:" in table
    assert len(re.findall(r'<input type="radio"[^>]* aria-label="Turned by \d+ degrees"', table)) == STEPS


def test_a_single_view_without_points_can_be_turned() -> None:
    markup = turntable({ViewId(0, "cam"): np.eye(4)}, {}, np.zeros((0, 3)), metric=False)
    assert len(drawings(markup)) == STEPS
    assert "nan" not in markup


def test_many_views_are_thinned_and_the_drawing_stays_small() -> None:
    rng = np.random.default_rng(0)
    poses = {}
    for index in range(1000):
        pose = np.eye(4)
        pose[:3, 3] = rng.normal(0, 3, 3)
        poses[ViewId(index // 30, f"cam{index % 30}")] = pose
    markup = turntable(poses, {}, rng.normal(0, 5, (100_000, 3)), metric=True)
    assert len(markup) < 2e6
    assert len(of_class(drawings(markup)[0], "camera")) == 200


def with_board(record: CalibrationRecord, *places: tuple[int, tuple[str, ...], tuple[float, float, float]]):
    """The record with a board of 0.4 m x 0.2 m that faced the first of the cameras at each place."""
    evidence = BoardEvidence(
        board=Board(columns=4, rows=3, square=0.1, marker=0.08),
        printed="",
        frames=1,
        views=1,
        corners=6,
        rms_px=0.1,
        places=tuple(
            BoardPlace(
                frame=frame, cameras=cameras, cam_from_board=Pose(quaternion=(1, 0, 0, 0), translation=shift)
            )
            for frame, cameras, shift in places
        ),
    )
    return changed(record, board=evidence)


def test_the_board_is_drawn_where_it_stood(toy: Path) -> None:
    record = with_board(
        read_calibration(toy),
        (7, ("cam0",), (0, 0, 1)),
        (8, ("cam0", "cam1"), (0, 0, 2)),
        (9, ("cam1",), (0, 0, 1)),
    )
    (figure,) = board_figures(record)
    shown = drawings(figure.drawing)
    for drawing in shown:
        assert len(of_class(drawing, "board")) == 3
        assert len(of_class(drawing, "camera")) == 2
        titles = [part.text for part in drawing.iter("title")]
        assert {"board, frame 7", "board, frame 8", "board, frame 9"} <= set(titles)

    def corners(part) -> np.ndarray:
        return np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", part.get("d")), float)

    # Drawn without perspective, the same board is the same shape at any distance, straight edges parallel.
    near, far, _ = (corners(part) for part in of_class(shown[0], "board"))
    np.testing.assert_allclose(near - near[0], far - far[0], atol=0.11)
    np.testing.assert_allclose(near[1] - near[0], near[2] - near[3], atol=0.11)
    assert not np.allclose(near, far, atol=5)
    ruler = of_class(shown[0], "ruler")[0].get("d")
    start, end = (float(number) for number in re.match(r"M([\d.]+) .*H([\d.]+)", ruler).groups())
    metres = float(re.search(r">(\d+) cm<", figure.drawing)[1]) / 100
    # No direction shows an edge longer than it is.
    longest = max(np.linalg.norm(np.diff(corners(of_class(d, "board")[0])[:2], axis=0)) for d in shown)
    assert 0.36 < longest / (end - start) * metres < 0.41


def test_cameras_that_never_saw_the_board_together_are_drawn_apart(toy: Path) -> None:
    record = with_board(read_calibration(toy), (7, ("cam0",), (0, 0, 1)), (7, ("cam1",), (0, 0, 2)))
    first, second = board_figures(record)
    assert first.heading == "The board before cam0"
    assert second.heading == "The board before cam1"
    groups = [re.findall(r'name="(\w+)"', figure.drawing)[0] for figure in (first, second)]
    assert len({*groups, "turn"}) == 3
    for figure in (first, second):
        assert all(len(of_class(drawing, "camera")) == 1 for drawing in drawings(figure.drawing))


def test_a_board_alone_has_its_drawing_on_the_page(toy: Path) -> None:
    record = with_board(read_calibration(toy), (7, ("cam0", "cam1"), (0, 0, 1)))
    titles = [figure.heading for figure in pose_topic(changed(record, views=()), None, NOTHING).figures]
    assert titles == ["The board before cam0, cam1"]
    assert not list(board_figures(read_calibration(toy)))
