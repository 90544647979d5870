"""The greys of a colour chart that the session was calibrated by, as the light of a perfect white."""

import cv2
import numpy as np

from calib.colour.chart_values import COLUMNS, NEUTRAL
from calib.luminance.area import LUMINANCE, AreaLight, area_light
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.session.calibration import CalibrationRecord
from imaging.session.calibration_evidence import ChartEvidence
from imaging.session.luminance import Area
from imaging.session.session import Session
from imaging.session.view_id import ViewId

WHITE = 19
"""Number of the white patch."""
DIMMEST = 0.08
"""Reflectance of greys that count: flare lifts the darker ones."""
OUTLINE = 0.5
"""Side of a patch's outline over the distance of patches; the corners of the chart are those of outlines."""
INNER = 0.3
"""Side of what is measured of a patch, over the distance of patches."""
PRINT_ERROR = 0.01
"""Relative: what a grey of a real chart may be off its published reflectance, all of them together."""


def chart_views(record: CalibrationRecord) -> tuple[ViewId, ...]:
    """The view of the first camera that saw a chart; CalibrationError if none did."""
    for camera in record.cameras:
        if camera.chart is not None and len(camera.chart.corners) == 4:
            return (ViewId(camera.chart.frame, camera.name),)
    raise CalibrationError(
        "no camera of the calibration saw a colour chart: add --chart, or name a view and an area of it."
    )


def chart_light(session: Session, record: CalibrationRecord) -> tuple[AreaLight, float]:
    """The light of a perfect white in the chart's place, and the reflectance of its white patch."""
    (view,) = chart_views(record)
    chart = record.camera(view.camera).chart
    assert chart is not None
    published = {patch.number: float(LUMINANCE @ np.array(patch.published)) for patch in chart.patches}
    numbers = [index + 1 for index in NEUTRAL if published.get(index + 1, 0.0) >= DIMMEST]
    if WHITE not in numbers:
        raise CalibrationError(
            f"the white patch of the chart in {view} is not usable: mark an area of it instead."
        )
    lights = [area_light(session, record, view, _area(chart, number)) for number in numbers]
    whites = np.array([one.light / published[number] for one, number in zip(lights, numbers, strict=True)])
    errors = np.array([one.error for one in lights])
    weight = 1.0 / (errors**2 + PRINT_ERROR**2)
    mean = float((weight * whites).sum() / weight.sum())
    spread = float(whites.std(ddof=1) / np.sqrt(len(whites)) / mean) if len(whites) > 1 else 0.0
    error = float(np.sqrt(max(spread**2, 1.0 / weight.sum()) + PRINT_ERROR**2))
    return AreaLight(mean, error, float(np.mean([one.radius for one in lights]))), published[WHITE]


def _area(chart: ChartEvidence, number: int) -> Area:
    """The middle of a patch, upright."""
    row, column = divmod(number - 1, COLUMNS)
    rows = 4
    ends = OUTLINE + np.array((COLUMNS - 1, rows - 1))
    corners = np.array([(0, 0), (ends[0], 0), ends, (0, ends[1])], np.float32)
    onto = cv2.getPerspectiveTransform(corners, np.array(chart.corners, np.float32))
    centre = np.array((column, row), np.float64) + OUTLINE / 2
    around = centre + INNER / 2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    outline: Array = cv2.perspectiveTransform(around[None].astype(np.float64), onto)[0]
    low, high = np.ceil(outline.min(axis=0)).astype(int), np.floor(outline.max(axis=0)).astype(int)
    return int(low[0]), int(low[1]), max(1, int(high[0] - low[0])), max(1, int(high[1] - low[1]))
