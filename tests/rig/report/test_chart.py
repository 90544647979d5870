"""Charts and the view from above: that what is drawn is where it should be."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from imaging.session.view_id import ViewId
from rig.report.charts.chart import (
    BOTTOM,
    HEIGHT,
    LEFT,
    RIGHT,
    TOP,
    WIDTH,
    Axis,
    AxisStyle,
    Series,
    chart,
    nice_step,
    tick_text,
)
from rig.report.charts.poses.topview import ground, top_view


def svg_of(markup: str) -> ElementTree.Element:
    return ElementTree.fromstring(re.search(r"<svg.*?</svg>", markup, re.DOTALL)[0])


@pytest.mark.parametrize(
    ("step", "nice"), [(0.7, 1), (1, 1), (1.1, 2), (3, 5), (7, 10), (0.03, 0.05), (20, 20)]
)
def test_steps_are_one_two_five(step: float, nice: float) -> None:
    assert nice_step(step) == pytest.approx(nice)


def test_an_axis_holds_its_values_and_its_ticks() -> None:
    axis = Axis.around(AxisStyle("x"), [0.13, 0.97])
    assert axis.low <= 0.13
    assert axis.high >= 0.97
    assert axis.ticks == pytest.approx((0.0, 0.2, 0.4, 0.6, 0.8, 1.0))
    assert [tick_text(tick, axis) for tick in axis.ticks] == ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]


def test_an_axis_of_equal_values_has_room() -> None:
    for value in (0.0, -3.0, 7.0):
        axis = Axis.around(AxisStyle("x"), [value, value])
        assert axis.low < value < axis.high


def test_a_logarithmic_axis_places_decades_evenly() -> None:
    axis = Axis.around(AxisStyle("x", "log"), [0.02, 30.0])
    assert (axis.low, axis.high) == pytest.approx((0.01, 100.0))
    assert axis.place(1.0, 0.0, 100.0) == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("values", "ends", "first", "last"),
    [
        ([6.9, 123.0], (5.0, 200.0), "5", "200"),
        ([16_805.0, 66_858.0], (10_000.0, 100_000.0), "10,000", "100,000"),
        ([0.94, 2.2], (0.5, 5.0), "0.5", "5"),
        ([3e-5, 2e-4], (2e-5, 2e-4), "2e-5", "2e-4"),
        ([3e7, 9e7], (2e7, 1e8), "2e7", "1e8"),
        ([7.0, 7.0], (5.0, 10.0), "5", "10"),
        ([1.0, 1.0], (1.0, 2.0), "1", "2"),
    ],
)
def test_a_logarithmic_axis_of_a_few_decades_is_no_longer_than_it_has_to_be(
    values: list[float], ends: tuple[float, float], first: str, last: str
) -> None:
    axis = Axis.around(AxisStyle("x", "log"), values)
    assert (axis.low, axis.high) == pytest.approx(ends)
    assert (axis.ticks[0], axis.ticks[-1]) == pytest.approx(ends)
    assert (tick_text(axis.ticks[0], axis), tick_text(axis.ticks[-1], axis)) == (first, last)
    assert len({tick_text(tick, axis) for tick in axis.ticks}) == len(axis.ticks) <= 8


def test_a_logarithmic_axis_of_less_than_a_decade_has_ticks_enough() -> None:
    axis = Axis.around(AxisStyle("x", "log"), [0.0204, 0.0391])
    assert [tick_text(tick, axis) for tick in axis.ticks] == ["0.02", "0.03", "0.04", "0.05"]


def test_a_logarithmic_axis_takes_the_largest_and_the_least_numbers() -> None:
    axis = Axis.around(AxisStyle("x", "log"), [5e-324, 1.7e308])
    assert len(axis.ticks) > 2
    assert all(0.0 <= axis.place(value, 0.0, 100.0) <= 100.0 for value in axis.ticks)
    svg_of(chart("t", [Series("", [5e-324, 1.7e308], [1, 2])], AxisStyle("x", "log"), "y"))


def test_nothing_to_draw_is_still_a_chart() -> None:
    for scale in ("linear", "log"):
        svg = svg_of(chart("empty", [Series("", [], [])], AxisStyle("x", scale), AxisStyle("y", scale)))
        assert {"x", "y"} <= {part.text for part in svg.iter()}
        assert not [part for part in svg.iter() if "dots" in part.get("class", "")]


def test_points_lie_where_the_axes_say() -> None:
    markup = chart("t", [Series("", [0, 10], [0, 5], dots=True)], "x", "y")
    (dots,) = [part for part in svg_of(markup) if "dots" in part.get("class", "")]
    assert dots.get("d") == f"M{LEFT:.1f} {HEIGHT - BOTTOM:.1f}h0M{WIDTH - RIGHT:.1f} {TOP:.1f}h0"


def test_what_is_not_finite_is_left_out() -> None:
    markup = chart("t", [Series("", [1, math.nan, 3], [1, 2, math.inf])], "x", "y")
    assert "nan" not in markup
    assert "inf" not in markup


def test_labels_are_escaped() -> None:
    markup = chart(
        "<script>t", [Series("<script>a", [1], [1]), Series("b", [1], [2])], "<script>x", "<script>y"
    )
    assert "<script>" not in markup
    assert markup.count("&lt;script&gt;") == 5


def look_from(centre: list[float], at: list[float]) -> np.ndarray:
    """cam_from_world of a camera with the world's z up."""
    forward = np.subtract(at, centre) / np.linalg.norm(np.subtract(at, centre))
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    motion = np.eye(4)
    motion[:3, :3] = [right, np.cross(forward, right), forward]
    motion[:3, 3] = -motion[:3, :3] @ centre
    return motion


def test_the_ground_is_level_whatever_the_cameras_tilt() -> None:
    poses = [look_from([x, -5.0, 2.0], [0, 0, 0]) for x in (-2.0, 0.0, 2.0)]
    right, away = ground(poses)
    np.testing.assert_allclose(right, [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(away, [0, 1, 0], atol=1e-9)


def test_cameras_that_look_straight_down_have_a_ground_too() -> None:
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    axes = ground([down, down])
    np.testing.assert_allclose(axes @ axes.T, np.eye(2), atol=1e-9)


def test_the_view_from_above_shows_left_to_the_left_and_far_up() -> None:
    poses = {ViewId(0, name): look_from([x, -5, 1], [0, 0, 1]) for name, x in (("left", -2), ("right", 2))}
    points = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 3.0], [-0.1, 0.2, 1.0]])
    svg = svg_of(top_view(poses, points, "above"))
    eyes = {
        group[0].text: (float(group[2].get("cx")), float(group[2].get("cy")))
        for group in svg
        if group.tag.endswith("g")
    }
    assert eyes["0000/left"][0] < eyes["0000/right"][0]
    (cloud,) = [part for part in svg if part.get("class") == "cloud"]
    height = float(re.match(r"M[\d.]+ ([\d.]+)h0", cloud.get("d"))[1])
    assert height < eyes["0000/left"][1]
