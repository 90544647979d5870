"""Sensors as the calibration's page draws them."""

import re
from pathlib import Path

import numpy as np
import pytest

from imaging.sensor.sensor_calibration import Measured, SensorCalibration
from rig.report.charts.sensor_charts import sensor_topic
from rig.report.sections.verdicts import verdicts

from .drawings import NOTHING, SENSOR, drawings, of_class, with_sensor


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
