"""The colours on a calibration's page: in their places, and nothing where nothing is known."""

import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response
from imaging.session.calibration_evidence import ChartEvidence, ChartPatch
from rig.report.charts.colour_chart import colour_topic, swatches

CHART = ChartEvidence(
    frame=3,
    chart="a chart",
    patches=(
        ChartPatch(number=1, measured=(1.0, 0.0, 0.0), published=(0.0, 1.0, 0.0), delta_e=12.34),
        ChartPatch(number=24, measured=(-0.1, 0.0, 7.0), published=(0.21586, 0.21586, 0.21586), delta_e=0.5),
    ),
    delta_e_mean=6.4,
    delta_e_p95=11.0,
    delta_e_max=12.34,
    delta_e_files=9.87,
)


def record(**camera: object) -> CalibrationRecord:
    plain = CameraCalibration(name="cam", serial="1", response=Response(kind="linear", evidence="RAW"))
    return CalibrationRecord(
        created=datetime.now(UTC),
        versions={},
        shots_sha256="0",
        cameras=(plain.model_copy(update=camera),),
        views=(),
        exposure_scale={},
    )


def test_patches_have_their_colours_and_places() -> None:
    drawing = str(swatches(CHART))
    assert '<rect x="0" y="0" width="100" height="100" fill="#ff0000"/>' in drawing
    assert '<rect x="25" y="25" width="50" height="50" fill="#00ff00"/>' in drawing
    # What a display cannot show is clipped; 50 % grey is code 128.
    assert '<rect x="530" y="318" width="100" height="100" fill="#0000ff"/>' in drawing
    assert '<rect x="555" y="343" width="50" height="50" fill="#808080"/>' in drawing
    assert ">12.3</text>" in drawing
    assert drawing.count("sheet-of") == 22


def test_the_topic_tells_figures_and_balance() -> None:
    topic = colour_topic(
        record(chart=CHART, white_balance=(1.05, 1.0, 0.97), white_balance_error=(0.003, 0.004, 0.003))
    )
    assert topic.figures[0].heading == "cam: the chart at frame 3"
    chart, balance = topic.tables
    assert chart.rows == (("cam", "2", "6.40", "11.00", "12.34", "9.87"),)
    assert balance.rows == (("cam", "1.0500 ± 0.0050", "0.9700 ± 0.0050", "1.0000 ± 0.0040"),)


def test_without_chart_and_balance_there_is_no_topic() -> None:
    assert colour_topic(record()).empty


def test_a_session_without_a_chart_is_told_so(rig: Callable[..., tuple[int, str, str]], toy: Path) -> None:
    before = (toy / "calibration" / "calibration.json").read_bytes()
    code, out, err = rig("calibrate", str(toy), "--only", "colour", "--chart")
    assert code == 2
    assert out == ""
    assert "no colour chart found (views searched: 6;" in err
    assert "leave --chart out" in err
    assert (toy / "calibration" / "calibration.json").read_bytes() == before
    code, _, err = rig("calibrate", str(toy), "--only", "poses", "--chart")
    assert code == 2
    assert "not the poses" in err
    code, out, _ = rig("calibrate", str(toy), "--only", "colour", "--json")
    assert code == 0
    assert json.loads(out)["charts"] == {}
