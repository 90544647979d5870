"""Sensors: photon transfer, linearity, and every level with its error (terms of EMVA 1288)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from imaging.arrays import Array
from imaging.sensor.sensor_calibration import Measured, SensorCalibration
from imaging.session.calibration import CalibrationRecord
from rig.report.charts.chart import AxisStyle, Series, chart
from rig.report.charts.topic import NOT_DETERMINED, Figure, Table, Topic, plus_minus

MOST_SENSORS = 6
"""Sensors whose photon transfer is drawn; more would hide each other."""
DIMMEST = 0.1
"""DN at which drawings begin; what is darker is drawn there."""
QUANTISATION = 1.0 / 12.0
"""DN^2 of rounding to whole numbers."""


@dataclass(frozen=True)
class NamedSensor:
    """A sensor with the name of its camera, and the ISO where a camera has several."""

    name: str
    sensor: SensorCalibration


def sensor_topic(record: CalibrationRecord) -> Topic:
    """Return what was measured of the sensors; an empty topic if nothing was."""
    sensors = [
        NamedSensor(
            camera.name
            + (f" at ISO {sensor.iso:g}" if len(camera.sensors) > 1 and sensor.iso is not None else ""),
            sensor,
        )
        for camera in record.cameras
        for sensor in camera.sensors
    ]
    if not sensors:
        return Topic("Sensors")
    return Topic("Sensors", figures=tuple(_figures(sensors)), tables=tuple(_tables(sensors)))


def _figures(sensors: Sequence[NamedSensor]) -> Iterable[Figure]:
    lines = [camera for camera in sensors if camera.sensor.gain is not None][:MOST_SENSORS]
    if lines:
        series = []
        for index, camera in enumerate(lines):
            points = [(max(x, DIMMEST), y) for x, y in camera.sensor.transfer if y > 0]
            series.append(_line(camera, index))
            series += [
                Series("", [x for x, _ in points], [y for _, y in points], dots=True, colour=index)
            ] * bool(points)
        measured = any(camera.sensor.transfer for camera in lines)
        more = len(sensors) - len(lines)
        yield Figure(
            "Photon transfer",
            "Variance in time against the mean signal. The slope is the gain, the level on the left the read "
            "noise. "
            + (
                "Dots: measured, one a stack of frames and colour (darks on the left edge). Lines: fitted."
                if measured
                else "Fitted lines; brackets of a scene leave no points to draw, darks and flats do."
            )
            + " The band holds the truth at 95 %."
            + (f" {more} more in the table." if more > 0 else ""),
            chart(
                "Photon transfer",
                series,
                AxisStyle("signal above black, DN", "log"),
                AxisStyle("variance, DN²", "log"),
            ),
        )
    plotted = [camera for camera in lines if camera.sensor.transfer]
    if plotted:
        yield Figure(
            "Photon transfer: off the line",
            "The same dots, relative to the fitted line. They scatter about zero where the model holds; "
            "a trend is a bend, a rise on the left noise that is not read noise.",
            chart(
                "Photon transfer, off the line",
                [_off(camera, lines.index(camera)) for camera in plotted],
                AxisStyle("signal above black, DN", "log"),
                "variance off the line, %",
                level=(0.0, ""),
            ),
        )
    bends = [camera for camera in sensors if camera.sensor.nonlinearity is not None]
    if bends:
        yield _linearity(max(bends, key=lambda camera: abs(_value(camera.sensor.nonlinearity))))


def _value(measured: Measured | None) -> float:
    return 0.0 if measured is None else measured.value


def _fitted(sensor: SensorCalibration, signal: Array) -> Array:
    """`K signal + (K read)^2 + 1/12`, DN^2."""
    dark = _value(sensor.gain) ** 2 * (_value(sensor.read_noise) ** 2 + _value(sensor.row_noise) ** 2)
    rounding = QUANTISATION if sensor.read_noise is not None else 0.0
    return np.asarray(_value(sensor.gain) * signal + dark + rounding)


def _off(camera: NamedSensor, colour: int) -> Series:
    """Return how far the measured variances are off the fitted ones, %."""
    signal, variance = np.array(camera.sensor.transfer).T
    off = 100 * (variance / np.maximum(_fitted(camera.sensor, signal), 1e-9) - 1)
    return Series(camera.name, np.maximum(signal, DIMMEST).tolist(), off.tolist(), dots=True, colour=colour)


def _line(camera: NamedSensor, colour: int) -> Series:
    """The fitted line, with the band that errors of gain and read noise leave."""
    sensor = camera.sensor
    gain, read, row = (_value(level) for level in (sensor.gain, sensor.read_noise, sensor.row_noise))
    gain_error, read_error = (
        0.0 if level is None else level.sigma for level in (sensor.gain, sensor.read_noise)
    )
    black = float(np.mean([level.value for level in chain(*sensor.black)])) if sensor.black else 0.0
    lit = [x for x, _ in sensor.transfer if x > 0]
    end = max(sensor.ceiling.value - black if sensor.ceiling else 0.0, max(lit, default=0.0), 100.0)
    signal = np.geomspace(DIMMEST, end, 60)
    variance = _fitted(sensor, signal)
    slope = signal + 2 * gain * (read**2 + row**2)
    error = np.hypot(slope * gain_error, 2 * gain**2 * read * read_error)
    return Series(
        camera.name, signal.tolist(), variance.tolist(), colour=colour, margin=(1.96 * error).tolist()
    )


def _linearity(camera: NamedSensor) -> Figure:
    bend = camera.sensor.nonlinearity
    assert bend is not None
    light = np.linspace(0.0, 1.0, 41)
    return Figure(
        "Linearity",
        f"How far the signal of {camera.name}, the least straight, departs from a straight line; the band "
        "holds the truth at 95 %. "
        + ("It counts as linear." if camera.sensor.linear else "It counts as bent, and is straightened."),
        chart(
            "Linearity deviation",
            [
                Series(
                    "",
                    (100 * light).tolist(),
                    (-100 * bend.value * light).tolist(),
                    margin=(196 * bend.sigma * light).tolist(),
                )
            ],
            "light, % of what white takes",
            AxisStyle("signal off the line, %", zero=True),
        ),
    )


def _tables(sensors: Sequence[NamedSensor]) -> Iterable[Table]:
    yield Table(
        "Noise",
        "Value ± standard error.",
        ("Camera", "#ISO", "#Gain K, DN/e⁻", "#Read noise, e⁻", "#Row noise, e⁻", "#PRNU, %", "#DSNU, e⁻",
         "#Dark current, e⁻/s", "From"),
        tuple(
            (
                camera.name,
                "unknown" if camera.sensor.iso is None else f"{camera.sensor.iso:g}",
                _with_error(camera.sensor.gain),
                _with_error(camera.sensor.read_noise),
                _with_error(camera.sensor.row_noise),
                _with_error(camera.sensor.prnu, 100.0),
                _with_error(camera.sensor.dsnu),
                _with_error(camera.sensor.dark_current),
                _sources(camera.sensor),
            )
            for camera in sensors
        ),
    )  # fmt: skip
    yield Table(
        "Levels",
        "Black of the darkest and the brightest site of the tile of colours, and where photosites saturate.",
        ("Camera", "#Least black, DN", "#Most, DN", "#Ceiling, DN",
         "#Full well, e⁻", "#Missing at white, %", "Defects"),
        tuple(
            (
                camera.name,
                *_ends(camera.sensor),
                _with_error(camera.sensor.ceiling),
                _with_error(camera.sensor.full_well),
                _with_error(camera.sensor.nonlinearity, 100.0),
                _defects(camera.sensor),
            )
            for camera in sensors
        ),
    )  # fmt: skip


def _ends(sensor: SensorCalibration) -> tuple[str, str]:
    """The least and the largest black of the sites."""
    if sensor.black is None:
        return NOT_DETERMINED, ""
    levels = sorted(chain(*sensor.black), key=lambda level: level.value)
    return plus_minus(levels[0].value, levels[0].sigma), plus_minus(levels[-1].value, levels[-1].sigma)


def _with_error(value: Measured | None, scale: float = 1.0) -> str:
    return NOT_DETERMINED if value is None else plus_minus(scale * value.value, scale * value.sigma)


def _sources(sensor: SensorCalibration) -> str:
    values = (sensor.gain, sensor.read_noise, sensor.prnu, sensor.dsnu, sensor.dark_current)
    return ", ".join(dict.fromkeys(value.source for value in values if value is not None)) or "nothing"


def _defects(sensor: SensorCalibration) -> str:
    if sensor.defects is None:
        return "not looked for"
    kinds = [defect.kind for defect in sensor.defects]
    words = [f"{kinds.count(kind)} {kind}" for kind in ("hot", "dead", "noisy") if kind in kinds]
    return ", ".join(words) or "none"
