"""Colours: the chart as each camera sees it beside the published one, and the white balance of the rig."""

from collections.abc import Iterable

import numpy as np
from markupsafe import Markup, escape

from imaging.colour.spaces import srgb_encode
from imaging.session.calibration import CalibrationRecord, CameraCalibration
from imaging.session.calibration_evidence import ChartEvidence, ChartPatch
from rig.report.charts.topic import Figure, Table, Topic, plus_minus
from rig.terminal.text import number

COLUMNS, ROWS = 6, 4
CELL, GAP = 100, 6


def colour_topic(record: CalibrationRecord) -> Topic:
    """Return the colours from charts and shared points; an empty topic without either."""
    return Topic("Colour", figures=tuple(_figures(record)), tables=tuple(_tables(record)))


def _figures(record: CalibrationRecord) -> Iterable[Figure]:
    for camera in record.cameras:
        if camera.chart is not None:
            yield Figure(
                f"{camera.name}: the chart at frame {camera.chart.frame}",
                "Each patch as the calibrated camera measures it, and in its middle as it was published; the "
                "number is how far apart they are (delta E 2000) under a fit without this patch. Below 1 "
                "no difference is visible; an empty patch was clipped, uneven or too dark.",
                swatches(camera.chart),
            )


def swatches(chart: ChartEvidence) -> Markup:
    """The chart as an `<svg>`: measured around published, and delta E of each patch."""
    width, height = COLUMNS * (CELL + GAP) - GAP, ROWS * (CELL + GAP) - GAP
    title = f"The chart, delta E 2000 {number(chart.delta_e_mean)} in the mean"
    parts = [
        f'<svg class="chart" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}">'
        f"<title>{escape(title)}</title>"
    ]
    patches = {patch.number: patch for patch in chart.patches}
    for index in range(COLUMNS * ROWS):
        row, column = divmod(index, COLUMNS)
        parts += _patch(patches.get(index + 1), column * (CELL + GAP), row * (CELL + GAP))
    return Markup("".join([*parts, "</svg>"]))


def _patch(patch: ChartPatch | None, x: int, y: int) -> Iterable[str]:
    if patch is None:
        yield f'<rect class="sheet-of" x="{x}" y="{y}" width="{CELL}" height="{CELL}"/>'
        return
    inner = CELL // 2
    at = (CELL - inner) // 2
    yield f'<rect x="{x}" y="{y}" width="{CELL}" height="{CELL}" fill="{_hex(patch.measured)}"/>'
    yield (
        f'<rect x="{x + at}" y="{y + at}" width="{inner}" height="{inner}" fill="{_hex(patch.published)}"/>'
    )
    ink = "#000" if float(np.mean(patch.published)) > 0.2 else "#fff"
    yield (
        f'<text x="{x + CELL / 2:g}" y="{y + CELL / 2 + 7:g}" text-anchor="middle" '
        f'style="fill:{ink};font-size:20px">{patch.delta_e:.1f}</text>'
    )


def _hex(linear: tuple[float, float, float]) -> str:
    codes = np.rint(255 * srgb_encode(np.array(linear))).astype(int)
    return "#" + "".join(f"{code:02x}" for code in codes)


def _tables(record: CalibrationRecord) -> Iterable[Table]:
    charts = [(camera.name, camera.chart) for camera in record.cameras if camera.chart is not None]
    if charts:
        yield Table(
            "How well the chart is met",
            "Delta E 2000 of patches under a fit that did not see them.",
            ("Camera", "#Patches", "#Mean", "#95 %", "#Largest", "#Mean with the files' matrix"),
            tuple(
                (
                    name,
                    str(len(chart.patches)),
                    f"{chart.delta_e_mean:.2f}",
                    f"{chart.delta_e_p95:.2f}",
                    f"{chart.delta_e_max:.2f}",
                    "none" if chart.delta_e_files is None else f"{chart.delta_e_files:.2f}",
                )
                for name, chart in charts
            ),
        )
    balanced = [camera for camera in record.cameras if camera.white_balance_error is not None]
    if balanced:
        yield Table(
            "White balance between cameras",
            "Sensitivities relative to the rig, from scene points that several cameras see: divided out.",
            ("Camera", "#Red over green", "#Blue over green", "#All"),
            tuple(_balance(camera) for camera in balanced),
        )


def _balance(camera: CameraCalibration) -> tuple[str, ...]:
    assert camera.white_balance_error is not None
    red, green, blue = camera.white_balance_error
    return (
        camera.name,
        plus_minus(camera.white_balance[0], float(np.hypot(red, green))),
        plus_minus(camera.white_balance[2], float(np.hypot(blue, green))),
        plus_minus(camera.gain, green * camera.gain),
    )
