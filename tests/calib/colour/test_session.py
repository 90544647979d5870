"""A session whose views show a chart: its cameras' colours, those of their twins, and refusals."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from calib.calibrate import calibrate
from calib.colour.chart_detection import DetectedChart
from calib.colour.chart_values import chart
from calib.colour.colour_record import charts_of, rebalanced
from calib.colour.fit import ChartPatches
from calib.colour.measure import Charts, colours
from calib.data.views import View
from calib.luminance.area import LUMINANCE
from imaging.colour.difference import delta_e
from imaging.colour.spaces import REC709_FROM_XYZ
from imaging.errors import CalibrationError, InputError
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.sensor.mosaic import Matrix, RawMosaic, as_matrix
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.luminance import LuminanceReading
from imaging.session.records import CameraRecord
from imaging.session.view_id import ViewId
from tests.calib.conftest import make_session

from .charts import painted, photograph, square_on

WIDTH, HEIGHT = 480, 320
TRUE = np.array([[0.50, 0.17, 0.03], [0.16, 0.72, 0.12], [0.02, 0.18, 0.56]])
FILES = TRUE @ np.array([[0.95, 0.05, 0.0], [0.05, 0.9, 0.05], [0.02, -0.02, 1.0]])
"""Matrices of the files: somewhat wrong."""
TINT = np.diag([1.15, 1.0, 0.85])
"""The light, which is not D65."""
TIMES = (0.125, 0.5, 2.0)


def shots(light: np.ndarray, files: np.ndarray, seed: int) -> list[tuple[RawMosaic, Exposure]]:
    """A bracket, its middle exposure near the top of the scale."""
    named: Matrix = as_matrix(files @ REC709_FROM_XYZ)
    return [
        (
            photograph(
                light, 0.8 * time / 0.5 / light.max(), seed=seed + step, camera_from_xyz=named, time=time
            ),
            Exposure(time=time, f_number=1.0, iso=100.0),
        )
        for step, time in enumerate(TIMES)
    ]


def chart_view(camera: np.ndarray, seed: int) -> list[tuple[RawMosaic, Exposure]]:
    patches = chart() @ camera.T
    light = painted(patches, camera @ np.ones(3), square_on(WIDTH, HEIGHT, 0.6), WIDTH, HEIGHT)
    return shots(light, FILES, seed)


def wall_view(camera: np.ndarray, seed: int) -> list[tuple[RawMosaic, Exposure]]:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    grey = 0.2 + 0.6 * x / WIDTH + 0.1 * np.sin(y / 20)
    return shots(grey[..., None] * (camera @ np.ones(3)), FILES, seed)


def made(folder: Path, views: Sequence[list], cameras: Sequence[str]) -> Path:
    return make_session(folder, views, cameras=cameras)


@pytest.fixture(scope="module")
def charted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Camera `a` sees the chart in its last frame, `b` of the same model never; calibrated with the chart."""
    folder = tmp_path_factory.mktemp("chart") / "session"
    lit = TINT @ TRUE
    views = [
        wall_view(lit, 10),
        wall_view(lit, 20),
        chart_view(lit, 30),
        wall_view(lit, 40),
        wall_view(lit, 50),
    ]
    made(folder, views, ["a", "a", "a", "b", "b"])
    calibrate(folder, only="colour", chart=True, on_progress=unreported)
    return folder


def colour_errors(record: CalibrationRecord, name: str) -> np.ndarray:
    """Delta E of the chart as camera `name` would show it, its white being right."""
    rgb = chart() @ (TINT @ TRUE).T / (TINT @ TRUE)[1].sum()
    matrix = record.camera(name).camera_from_rec709
    assert matrix is not None
    return delta_e(rgb @ np.linalg.inv(matrix).T, chart())


def test_colours_come_from_the_chart(charted: Path) -> None:
    record = read_calibration(charted)
    evidence = record.camera("a").chart
    assert evidence is not None
    assert evidence.frame == 2
    assert len(evidence.patches) == 24
    assert evidence.delta_e_mean < 0.5
    assert evidence.delta_e_mean <= evidence.delta_e_p95 <= evidence.delta_e_max
    assert evidence.delta_e_files is not None
    assert evidence.delta_e_files > 3 * evidence.delta_e_mean
    assert colour_errors(record, "a").max() < 1.0
    published = np.array([patch.published for patch in evidence.patches])
    assert published == pytest.approx(chart())
    measured = np.array([patch.measured for patch in evidence.patches])
    assert delta_e(measured, published).max() < 1.0
    true = square_on(WIDTH, HEIGHT, 0.6)
    assert np.abs(np.array(evidence.corners) - true).max() < 0.1 * WIDTH
    rungs = {rung.name: rung for rung in record.rungs}
    assert rungs["chart_white"].taken
    assert rungs["chart_matrix"].taken
    assert not rungs["chart_shading"].taken
    assert "chart that a saw" in rungs["camera_colour"].reason


def test_a_twin_that_saw_no_chart_has_the_same_colours(charted: Path) -> None:
    record = read_calibration(charted)
    assert record.camera("b").chart is None
    assert record.camera("b").camera_from_rec709 == record.camera("a").camera_from_rec709


@pytest.mark.parametrize("illuminance", [True, False])
def test_its_greys_are_the_scale_of_light_where_its_luminance_is_read(
    illuminance: bool, charted: Path, tmp_path: Path
) -> None:
    session = Path(shutil.copytree(charted, tmp_path / "session"))
    camera = TINT @ TRUE
    patches = chart() @ camera.T
    light = painted(patches, camera @ np.ones(3), square_on(WIDTH, HEIGHT, 0.6), WIDTH, HEIGHT)
    white, candelas = 1.6 * camera[1].sum() / light.max(), 250.0
    read = {"illuminance": np.pi * candelas * white}
    if not illuminance:  # off the white patch
        read = {"luminance": candelas * white * float(LUMINANCE @ chart()[18])}
    reading = LuminanceReading(**read, error=0.04, source="meter")
    scale = calibrate(session, only="luminance", luminance=[reading]).luminance
    assert scale is not None
    assert scale.value == pytest.approx(candelas, rel=0.01)
    assert scale.cameras == ("a",)
    assert scale.readings[0].views == (ViewId(2, "a"),)
    assert 0.04 * candelas < scale.error < 0.08 * candelas


def test_what_an_earlier_calibration_knew_of_charts_is_kept(charted: Path) -> None:
    charts = charts_of(read_calibration(charted))
    assert set(charts.evidence) == {"a"}
    assert set(charts.matrices) == {"a", "b"}
    assert {rung.name for rung in charts.rungs} == {"chart_white", "chart_shading", "chart_matrix"}


def test_balance_is_kept_relative_to_the_cameras_of_the_chart(charted: Path) -> None:
    record = read_calibration(charted)
    balance = {"a": (1.1, 1.0, 0.9), "b": (0.9, 1.0, 1.2)}
    cameras = tuple(one.model_copy(update={"white_balance": balance[one.name]}) for one in record.cameras)
    again = rebalanced(record.model_copy(update={"cameras": cameras}))
    assert again.camera("a").white_balance == (1.0, 1.0, 1.0)
    assert again.camera("a").camera_from_rec709 == record.camera("a").camera_from_rec709
    assert again.camera("b").white_balance == pytest.approx((0.9 / 1.1, 1.0, 1.2 / 0.9))
    expected = np.array((0.9 / 1.1, 1.0, 1.2 / 0.9))[:, None] * np.array(
        record.camera("b").camera_from_rec709
    )
    assert np.array(again.camera("b").camera_from_rec709) == pytest.approx(expected)


def test_colours_of_the_files_come_back_without_the_chart(charted: Path) -> None:
    before = json.loads((charted / "calibration" / "calibration.json").read_text())
    try:
        record = calibrate(charted, only="colour", on_progress=unreported)
        assert record.camera("a").chart is None
        assert np.array(record.camera("a").camera_from_rec709) == pytest.approx(
            FILES / FILES[1].sum(), abs=1e-4
        )
        assert not [rung for rung in record.rungs if rung.name.startswith("chart")]
    finally:
        (charted / "calibration" / "calibration.json").write_text(json.dumps(before))


def test_no_chart_and_no_use_of_one_are_refused(charted: Path, tmp_path: Path) -> None:
    blank = made(tmp_path / "blank", [wall_view(TRUE, 1)], ["a"])
    with pytest.raises(CalibrationError, match=r"no colour chart found \(views searched: 1; nothing looks"):
        calibrate(blank, only="colour", chart=True, on_progress=unreported)
    assert not (blank / "calibration").exists()
    with pytest.raises(InputError, match="not the response"):
        calibrate(charted, only="response", chart=True, on_progress=unreported)
    photos = make_session(
        tmp_path / "photos",
        [[(np.full((64, 96, 3), 99, np.uint8), Exposure(time=1.0, f_number=1.0, iso=100.0))]],
    )
    with pytest.raises(CalibrationError, match="has no RAW view"):
        calibrate(photos, only="colour", chart=True, on_progress=unreported)


def found_of(camera: np.ndarray, seed: int) -> DetectedChart:
    """Patches of a chart, a per cent of noise on each."""
    random = np.random.default_rng(seed)
    rgb = chart() @ camera.T * random.lognormal(0, 0.01, (24, 3))
    row, column = np.divmod(np.arange(24), 6)
    place = np.stack([column / 2.5 - 1, row / 1.5 - 1], axis=1)
    return DetectedChart(ChartPatches(rgb, 0.01 * rgb, place, np.ones(24, bool)), np.zeros((24, 4, 2)), 1.0)


def seen_by_two(cameras: dict[str, np.ndarray]) -> Charts:
    charts = {
        name: (View(CameraRecord(name=name, serial=name, kind="raw"), 0, ()), found_of(camera, index))
        for index, (name, camera) in enumerate(cameras.items())
    }
    files = {name: as_matrix(FILES / FILES[1].sum()) for name in cameras}
    return colours(charts, files, dict.fromkeys(cameras, "one model"))


def test_cameras_of_a_model_share_a_matrix_and_have_whites_of_their_own() -> None:
    charts = seen_by_two({"a": TRUE, "b": TINT @ TRUE})
    rungs = {rung.name: rung for rung in charts.rungs}
    assert rungs["chart_matrix"].taken
    assert not rungs["chart_matrix_each_camera"].taken
    one, other = (np.array(charts.matrices[name]) for name in "ab")
    # Up to whites, the rows are the same.
    rows = other / one
    assert np.ptp(rows, axis=1) == pytest.approx(np.zeros(3), abs=1e-9)
    assert rows[:, 0] == pytest.approx(np.diag(TINT), rel=0.01)


def test_cameras_whose_patches_say_so_get_a_matrix_each() -> None:
    filtered = TRUE @ np.array([[0.8, 0.2, 0.0], [0.1, 0.8, 0.1], [0.0, 0.25, 0.75]])
    charts = seen_by_two({"a": TRUE, "b": filtered})
    assert {rung.name: rung.taken for rung in charts.rungs}["chart_matrix_each_camera"]
    matrix = np.array(charts.matrices["b"])
    assert matrix == pytest.approx(filtered / filtered[1].sum(), abs=0.02)
