"""The charts of a calibration: exposure labels, vignetting, response."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup

from imaging.arrays import Array
from imaging.session.calibration import CalibrationRecord, CameraCalibration
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from rig.report.charts.chart import AxisStyle, Series, chart


def charts(session: Session, record: CalibrationRecord) -> Iterable[tuple[str, str, Markup]]:
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
                AxisStyle("stated exposure scale k, s", "log"),
                AxisStyle("estimate − label, stops", zero=True),
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


def _ratio_series(session: Session, record: CalibrationRecord) -> list[Series]:
    series = []
    shots = session.shots("scene")
    for camera in record.cameras:
        ratios = [
            ((shot.reported or shot.requested), ratio)
            for shot in shots
            if shot.camera == camera.name and (ratio := label_ratio(shot, record)) is not None
        ]
        pairs = sorted((label.scale, math.log2(ratio)) for label, ratio in ratios if label is not None)
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
        codes = np.array(response.codes)
        # The ends share their last measured code with the middle, so that the line does not break.
        inside = np.flatnonzero((codes >= response.valid[0]) & (codes <= response.valid[1]))
        first, last = (inside[0], inside[-1]) if len(inside) else (0, len(codes) - 1)
        parts = ((0, first + 1, True), (first, last + 1, False), (last, len(codes), True))
        for channel, name in enumerate(("red", "green", "blue")[: len(response.log_exposure)]):
            stops = np.array(response.log_exposure[channel]) / math.log(2)
            colour = (3, 2, 0)[channel]
            margin = 1.96 * np.array(response.sigma[channel]) / math.log(2) if response.sigma else None
            for start, end, dashed in parts:
                if end - start > 1:
                    series.append(
                        Series(
                            "" if dashed else prefix + name,
                            codes[start:end].tolist(),
                            stops[start:end].tolist(),
                            dashed=dashed,
                            colour=colour,
                            margin=() if margin is None else margin[start:end].tolist(),
                        )
                    )
            if margin is not None:
                errors.append(Series(prefix + name, codes.tolist(), margin.tolist(), colour=colour))
    valid = cameras[0].response.valid
    yield (
        "Response",
        "Light that a code value stands for. Solid: between the codes where it was measured; dashed: "
        "extrapolated beyond. The band holds the truth at 95 %.",
        chart("Camera response", series, "code value", "log2 exposure, stops", shaded=valid),
    )
    if errors:
        yield (
            "Response: how sure",
            "Half the width of that band. It is missing where the curves are tied to a common scale.",
            chart(
                "Uncertainty of the response",
                errors,
                "code value",
                AxisStyle("± stops, 95 %", zero=True),
                shaded=valid,
            ),
        )


def label_ratio(shot: ShotRecord, calibration: CalibrationRecord | None) -> float | None:
    """Estimated exposure scale over the one that the file's label states; None if either is not known."""
    label = shot.reported or shot.requested
    if label is None:
        return None
    if calibration is not None and shot.file in calibration.exposure_scale:
        return calibration.exposure_scale[shot.file] / label.scale
    return None if shot.estimated is None else shot.estimated.scale / label.scale
