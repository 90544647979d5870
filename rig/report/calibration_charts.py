"""The charts of a calibration: exposure labels, vignetting, response, reprojection error."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from imaging.calibration import CalibrationRecord, CameraCalibration
from imaging.colmap import SparsePoints
from imaging.session import Session
from rig.report.captured import label_ratio
from rig.report.chart import Series, chart

Array = npt.NDArray[np.float64]


def charts(
    session: Session, record: CalibrationRecord, points: SparsePoints | None
) -> Iterable[tuple[str, str, Markup]]:
    """Every chart that this calibration gives something to draw: heading, explanation, drawing."""
    ratios = _ratio_series(session, record)
    if any(stops for series in ratios for stops in series.y):
        yield (
            "Exposure: label against estimate",
            "How far each shot's exposure, estimated from overlapping pixels, lies from what its file says. "
            "Shutter labels are rounded, so a few hundredths of a stop are normal.",
            chart(
                "Estimated over stated exposure",
                ratios,
                "stated exposure scale k, s",
                "estimate − label, stops",
                x_scale="log",
                y_zero=True,
            ),
        )
    if any(any(camera.vignetting) for camera in record.cameras):
        radius = np.linspace(0, 1, 41)
        yield (
            "Vignetting",
            "Light that reaches a pixel, relative to the image centre.",
            chart(
                "Vignetting",
                [
                    Series(camera.name, radius.tolist(), _falloff(camera, radius).tolist())
                    for camera in record.cameras
                ],
                "distance from the centre, half diagonals",
                "relative light",
            ),
        )
    curves = [
        camera for camera in record.cameras if camera.response.kind == "curve" and camera.response.codes
    ]
    if curves:
        yield from _response_charts(curves)
    if points is not None and len(points.error):
        yield (
            "Reprojection error",
            "How far the scene points land from where they were seen, one count a point.",
            _error_histogram(points),
        )


def _ratio_series(session: Session, record: CalibrationRecord) -> list[Series]:
    series = []
    shots = session.shots("scene")
    for camera in record.cameras:
        known = [
            ((shot.reported or shot.requested), ratio)
            for shot in shots
            if shot.camera == camera.name and (ratio := label_ratio(shot, record)) is not None
        ]
        pairs = sorted((label.scale, math.log2(ratio)) for label, ratio in known if label is not None)
        if pairs:
            series.append(Series(camera.name, [k for k, _ in pairs], [s for _, s in pairs], dots=True))
    return series


def _falloff(camera: CameraCalibration, radius: Array) -> Array:
    a, b, c = camera.vignetting
    return np.asarray(1 + a * radius**2 + b * radius**4 + c * radius**6)


def _response_charts(cameras: Sequence[CameraCalibration]) -> Iterable[tuple[str, str, Markup]]:
    """One curve a channel; cameras that share a curve (as a rig usually does) are drawn once."""
    distinct = {camera.response: camera for camera in reversed(cameras)}
    series, errors = [], []
    for response, camera in distinct.items():
        prefix = f"{camera.name} " if len(distinct) > 1 else ""
        for channel, name in enumerate(("red", "green", "blue")[: len(response.log_exposure)]):
            stops = np.array(response.log_exposure[channel]) / math.log(2)
            codes, colour = list(response.codes), (3, 2, 0)[channel]
            series.append(Series(prefix + name, codes, stops.tolist(), colour=colour))
            if response.sigma:
                margin = 1.96 * np.array(response.sigma[channel]) / math.log(2)
                for edge in (stops - margin, stops + margin):
                    series.append(Series("", codes, edge.tolist(), dashed=True, colour=colour))
                errors.append(Series(prefix + name, codes, margin.tolist(), colour=colour))
    valid = cameras[0].response.valid
    yield (
        "Response",
        "Light that a code value stands for. Shaded: the codes between which it was measured; "
        "beyond, it is extrapolated. Dashed: the band that holds the truth at 95 %.",
        chart("Camera response", series, "code value", "log2 exposure, stops", shaded=valid),
    )
    if errors:
        yield (
            "Response: how sure",
            "Half the width of that band. It is none where the curves are tied to a common scale.",
            chart(
                "Uncertainty of the response",
                errors,
                "code value",
                "± stops, 95 %",
                y_zero=True,
                shaded=valid,
            ),
        )


def _error_histogram(points: SparsePoints) -> Markup:
    top = max(float(np.percentile(points.error, 99)), 1e-6)
    counts, edges = np.histogram(np.minimum(points.error, top), bins=30, range=(0, top))
    x = np.repeat(edges, 2)[1:-1]
    y = np.repeat(counts, 2)
    return chart(
        "Reprojection errors",
        [Series("", x.tolist(), y.astype(float).tolist())],
        "mean reprojection error of a point, px",
        "points",
        y_zero=True,
    )
