"""Shared parts of the tests of a calibration's page: reading of drawings, and filled records."""

import re
from pathlib import Path
from xml.etree import ElementTree

from imaging.sensor.sensor_calibration import Defect, Measured, SensorCalibration
from imaging.session.calibration import CalibrationRecord, read_calibration
from rig.report.charts.residuals import Residuals

NOTHING = Residuals({}, {})


def drawings(markup: str) -> list[ElementTree.Element]:
    return [ElementTree.fromstring(text) for text in re.findall(r"<svg.*?</svg>", markup, re.DOTALL)]


def of_class(drawing: ElementTree.Element, kind: str) -> list[ElementTree.Element]:
    return [part for part in drawing.iter() if kind in part.get("class", "").split()]


def changed(record: CalibrationRecord, **update: object) -> CalibrationRecord:
    """The same with other fields, checked."""
    return CalibrationRecord.model_validate(record.model_copy(update=update).model_dump())


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
