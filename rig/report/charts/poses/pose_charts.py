"""Poses: the rig and its views in space, how sure each view is, how well it fits, and the least sure ones."""

from collections.abc import Iterable, Mapping

import numpy as np

from imaging.files.colmap import SparsePoints
from imaging.session.calibration import CalibrationRecord, ViewCalibration
from imaging.session.coordinates import SurveyedPoint, length_text
from imaging.session.view_id import ViewId
from rig.report.charts.chart import COLOURS, AxisStyle, Series, chart
from rig.report.charts.poses.board_view import board_figures
from rig.report.charts.poses.rig_view import MOST_VIEWS, turntable
from rig.report.charts.poses.topview import top_view
from rig.report.charts.residuals import Residuals
from rig.report.charts.topic import NOT_DETERMINED, Figure, Table, Topic
from rig.terminal.text import number

WORST = 10
"""Views in the table of the least sure."""


def pose_topic(record: CalibrationRecord, points: SparsePoints | None, residuals: Residuals) -> Topic:
    """Return what is known of where cameras and boards were; an empty topic if nothing is."""
    boards = tuple(board_figures(record))
    if not record.views:
        return Topic("Poses", figures=boards)
    return Topic(
        "Poses",
        figures=(*_figures(record, points, residuals), *boards),
        tables=(*coordinate_tables(record), _least_sure(record, residuals)),
    )


def _figures(
    record: CalibrationRecord, points: SparsePoints | None, residuals: Residuals
) -> Iterable[Figure]:
    poses = {view.id: view.cam_from_world.matrix() for view in record.views}
    cloud = points.xyz if points is not None else np.zeros((0, 3))
    few = f" {MOST_VIEWS} of {len(poses)} views at most are drawn." if len(poses) > MOST_VIEWS else ""
    yield Figure(
        "Rig and scene",
        "Each pyramid is a view, open towards what it sees"
        + (
            "; the cameras of a frame are joined. "
            if len({view.frame for view in poses}) < len(poses)
            else ". "
        )
        + f"Turn it with the row of buttons, or with the arrow keys.{few}",
        turntable(
            poses,
            {camera.name: camera.lens for camera in record.cameras if camera.lens is not None},
            cloud,
            metric=record.unit == "m",
        ),
        wide=True,
    )
    turns = {view.id: view.error.rotation for view in record.views if view.error is not None}
    if turns:
        yield Figure(
            "How sure the poses are",
            "Standard error of each view's rotation about its worst axis, by frame.",
            chart(
                "Standard error of rotation",
                _by_camera(turns),
                AxisStyle("frame", whole=True),
                AxisStyle("standard error, °", zero=True),
            ),
        )
    if residuals.views:
        yield Figure(
            "How well the views fit",
            "Root mean square of how far scene points land from where a view saw them, by frame.",
            chart(
                "Residuals by view",
                _by_camera(residuals.views),
                AxisStyle("frame", whole=True),
                AxisStyle("rms residual, px", zero=True),
            ),
        )
    yield Figure(
        "From above",
        "Cameras open towards where they look; dots are scene points.",
        top_view(poses, cloud, "Cameras and scene points seen from above"),
    )


def _by_camera(values: Mapping[ViewId, float]) -> list[Series]:
    """Split into one cloud a camera; with too many cameras for colours, one cloud in all."""
    names = sorted({view.camera for view in values})
    groups = [[name] for name in names] if len(names) <= COLOURS else [names]
    return [
        Series(
            group[0] if len(groups) > 1 else "",
            [float(view.frame) for view in values if view.camera in group],
            [value for view, value in values.items() if view.camera in group],
            dots=True,
        )
        for group in groups
    ]


def _least_sure(record: CalibrationRecord, residuals: Residuals) -> Table:
    with_errors = any(view.error is not None for view in record.views)
    unit, scale = ("mm", 1000.0) if record.unit == "m" else ("relative", 1.0)

    def doubt(view: ViewCalibration) -> tuple[float, float]:
        error = float("inf") if view.error is None else view.error.rotation
        return (-error, float(view.points)) if with_errors else (float(view.points), 0.0)

    worst = sorted(record.views, key=doubt)[:WORST]
    return Table(
        "The least sure views" if with_errors else "The views with the fewest scene points",
        "Standard errors about and along the worst axis."
        if with_errors
        else "Standard errors of the poses are not determined.",
        ("View", "#Rotation, °", f"#Place, {unit}", "#Scene points", "#Residual, rms px"),
        tuple(
            (
                str(view.id),
                NOT_DETERMINED if view.error is None else f"± {number(view.error.rotation, 2)}",
                NOT_DETERMINED if view.error is None else f"± {number(scale * view.error.translation, 2)}",
                f"{view.points:,}",
                number(residuals.views.get(view.id), 2),
            )
            for view in worst
        ),
    )


_SOURCES = {
    "survey": "by surveyed points",
    "gps": "by the positions in the photographs",
    "session": "by another session",
}


def coordinate_tables(record: CalibrationRecord) -> Iterable[Table]:
    """Yield what the scene was placed by; nothing where its coordinates are its own."""
    known = record.coordinates
    if known is None:
        return
    unit = "m" if record.unit == "m" else "relative"
    yield Table(
        "Coordinates",
        f"Poses and points are in {known.described}{known.less_offset}, placed {_SOURCES[known.source]}. "
        "Errors are standard errors, of the whole scene.",
        ("#Scale, %", "#Turn, °", f"#Place, {unit}", f"#Misses, rms {unit}", "#Used", "#Left out"),
        (
            (
                "known before" if known.scale_error is None else f"± {number(100 * known.scale_error, 2)}",
                f"± {number(known.rotation_error, 2)}",
                f"± {number(known.position_error, 2)}",
                number(known.rms, 3),
                f"{known.used:,}",
                f"{known.left_out:,}",
            ),
        ),
    )
    if known.points:
        yield Table(
            "Surveyed points",
            "From where each was surveyed to where the scene has it, and from its marks to where the views "
            "should show it.",
            ("Point", "#x", "#y", "#z", "#Off", "#Off, rms px", "#Images", "Used"),
            tuple(_row(point) for point in known.points),
        )


def _row(point: SurveyedPoint) -> tuple[str, ...]:
    axes = [NOT_DETERMINED] * 4
    if point.miss is not None and point.miss_m is not None:
        axes = [_signed(one) for one in point.miss] + [length_text(point.miss_m)]
    pixels = NOT_DETERMINED if point.miss_px is None else number(point.miss_px, 3)
    used = "; ".join(filter(None, ("yes" if point.used else "no", point.reason)))
    return point.name, *axes, pixels, str(len(point.marks)), used


def _signed(value: float) -> str:
    sign = "−" if value < 0 else "+"
    return f"{sign}{length_text(abs(value))}"
