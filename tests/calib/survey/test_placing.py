"""A simulated scene placed by points of it, whose places the simulator knows."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.calibration.pose_error import true_poses
from calib.calibrate import calibrate
from calib.data.unfinished import FOLDER
from calib.poses.sfm import SceneModel, centres
from calib.request import CalibrationRequest
from calib.survey.placing import Expected, place_by_survey
from calib.survey.points import Survey, SurveyPosition
from imaging.arrays import Array
from imaging.errors import CalibrationError, InputError, PartialError
from imaging.files.colmap import read_points
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from tests.calib.conftest import STEPS, even_light
from tests.calib.survey.conftest import Staked, write_marks, write_points

ModelOf = Callable[[Path], SceneModel]
SIZES = {f"cam{number}": (320, 240) for number in range(4)}
CLICK = 0.3
"""px, standard error of a click."""
UTM = np.array([441_000.0, 5_412_000.0, 300.0])


def survey_of(places: dict[str, Array], sigma: float | None = 0.002, system: str = "local") -> Survey:
    return Survey({n: SurveyPosition((p[0], p[1], p[2]), sigma) for n, p in places.items()}, system)


def off(model: SceneModel, session: Path) -> Array:
    """Distances of the cameras from where they truly are, m."""
    truth = true_poses(session)
    views = sorted(model.poses)
    true = np.array([-truth[view][:3, :3].T @ truth[view][:3, 3] for view in views])
    return np.asarray(np.linalg.norm(centres([model.poses[view] for view in views]) - true, axis=1))


def test_cameras_stand_where_they_truly_are(arm: Path, staked: Staked, model_of: ModelOf) -> None:
    for seed in range(3):
        model, coordinates = place_by_survey(
            model_of(arm), survey_of(staked.places), staked.marks(CLICK, seed), SIZES
        )
        assert model.metric
        assert (coordinates.used, coordinates.left_out) == (10, 0)
        assert coordinates.rms < 0.02
        # The cameras stand about 2 m from the points: what scale and turn err by is that much there.
        assert coordinates.scale_error is not None
        reach = (
            2.5 * (coordinates.scale_error + np.radians(coordinates.rotation_error))
            + coordinates.position_error
        )
        assert off(model, arm).max() < 3 * reach
        assert 1e-4 < coordinates.scale_error < 5e-3
        for point in coordinates.points:
            assert point.used
            assert point.miss_px is not None
            assert point.miss_px < 3 * CLICK
    exact, _ = place_by_survey(model_of(arm), survey_of(staked.places), staked.marks(0.0), SIZES)
    assert off(exact, arm).max() < 0.01


def test_exchanged_names_are_found(arm: Path, staked: Staked, model_of: ModelOf) -> None:
    places = {**staked.places, "P0": staked.places["P1"], "P1": staked.places["P0"]}
    model, coordinates = place_by_survey(model_of(arm), survey_of(places), staked.marks(CLICK), SIZES)
    assert {point.name for point in coordinates.points if not point.used} == {"P0", "P1"}
    assert off(model, arm).max() < 0.03
    assert "P0 and P1 fit if their names are exchanged" in model.rungs[-1].reason


def test_a_wrong_coordinate_is_found(arm: Path, staked: Staked, model_of: ModelOf) -> None:
    places = {**staked.places, "P4": staked.places["P4"] + (0.0, 0.0, 0.1)}
    _, coordinates = place_by_survey(model_of(arm), survey_of(places), staked.marks(CLICK), SIZES)
    assert {point.name for point in coordinates.points if not point.used} == {"P4"}
    (wrong,) = (point for point in coordinates.points if not point.used)
    assert wrong.miss_m == pytest.approx(0.1, rel=0.2)


def test_a_wrong_mark_is_found(arm: Path, staked: Staked, model_of: ModelOf) -> None:
    marks = staked.marks(CLICK)
    view = next(iter(marks["P2"]))
    marks["P2"][view] = marks["P2"][view].model_copy(update={"at": (200.0, 30.0)})
    _, coordinates = place_by_survey(model_of(arm), survey_of(staked.places), marks, SIZES)
    point = next(point for point in coordinates.points if point.name == "P2")
    assert point.used
    assert str(view) in point.reason


def test_few_points_that_do_not_fit_are_refused(arm: Path, staked: Staked, model_of: ModelOf) -> None:
    places = dict(list(staked.places.items())[:4])
    places["P0"], places["P1"] = places["P1"], places["P0"]
    with pytest.raises(CalibrationError, match="P0 and P1 fit if their names are exchanged"):
        place_by_survey(model_of(arm), survey_of(places), staked.marks(CLICK), SIZES)
    with pytest.raises(CalibrationError, match="do not fit"):
        place_by_survey(model_of(arm), survey_of(dict(list(places.items())[:3])), staked.marks(CLICK), SIZES)


@pytest.mark.parametrize("factor", [1000, 1 / 0.3048])
def test_heights_in_another_unit_are_refused(
    arm: Path, staked: Staked, model_of: ModelOf, factor: float
) -> None:
    places = {name: place * (1, 1, factor) for name, place in staked.places.items()}
    with pytest.raises(CalibrationError, match="another unit"):
        place_by_survey(model_of(arm), survey_of(places), staked.marks(CLICK), SIZES)


@pytest.mark.parametrize(("factor", "unit"), [(1000, "millimetres"), (1 / 0.3048, "feet"), (1.3, "correct")])
def test_another_unit_than_the_board_s_is_refused(
    arm: Path, staked: Staked, model_of: ModelOf, factor: float, unit: str
) -> None:
    model, _ = place_by_survey(model_of(arm), survey_of(staked.places), staked.marks(CLICK), SIZES)
    places = {name: factor * place for name, place in staked.places.items()}
    board = Expected(1.0, "the board", 0.05)
    with pytest.raises(CalibrationError, match=unit):
        place_by_survey(model, survey_of(places), staked.marks(CLICK), SIZES, board)


def test_exchanged_axes_of_projected_points_are_refused(arm: Path, staked: Staked, model_of: ModelOf) -> None:
    """Points of one plane fit as in a mirror, if the cameras may stand below the ground."""
    places = {name: place[[1, 0, 2]] for name, place in staked.places.items()}
    with pytest.raises(CalibrationError, match="exchanged"):
        place_by_survey(model_of(arm), survey_of(places, system="EPSG:25832"), staked.marks(CLICK), SIZES)


def test_points_on_a_line_and_too_few_marks_are_refused(arm: Path, staked: Staked, model_of: ModelOf) -> None:
    line = {name: np.array([float(place), 0, 0]) for place, name in enumerate(staked.places)}
    with pytest.raises(CalibrationError, match="on a line"):
        place_by_survey(model_of(arm), survey_of(line), staked.marks(CLICK), SIZES)
    marks = {name: by_view for name, by_view in staked.marks(CLICK).items() if name in ("P0", "P1")}
    with pytest.raises(CalibrationError, match="P2 \\(without a mark\\)"):
        place_by_survey(model_of(arm), survey_of(staked.places), marks, SIZES)


@pytest.fixture(scope="module")
def unsurveyed(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm as if its calibration had been stopped when all views were placed; it goes on in copies."""
    session = Path(shutil.copytree(arm, tmp_path_factory.mktemp("unsurveyed") / "session"))

    shutil.copytree(arm.with_name(STEPS), session / FOLDER)
    return session


@pytest.fixture(scope="module")
def placed(unsurveyed: Path, staked: Staked, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm, calibrated in UTM coordinates."""
    folder = tmp_path_factory.mktemp("placed")
    session = Path(shutil.copytree(unsurveyed, folder / "session"))
    points = write_points(folder / "points.csv", {name: place + UTM for name, place in staked.places.items()})
    points.write_text("# EPSG:25832\n" + points.read_text())
    marks = write_marks(folder / "marks.csv", staked.marks(CLICK))
    with even_light():
        calibrate(session, CalibrationRequest(only="poses", survey=points, marks=marks))
    return session


def test_large_coordinates_are_kept_apart(placed: Path) -> None:
    record = read_calibration(placed)
    assert record.unit == "m"
    coordinates = record.coordinates
    assert coordinates is not None
    assert (coordinates.source, coordinates.system) == ("survey", "EPSG:25832")
    np.testing.assert_array_equal(coordinates.offset, UTM)
    truth = true_poses(placed)
    for view in record.views:
        here, there = view.cam_from_world.matrix(), truth[view.id]
        np.testing.assert_allclose(here[:3, :3], there[:3, :3], atol=0.01)
        np.testing.assert_allclose(-here[:3, :3].T @ here[:3, 3], -there[:3, :3].T @ there[:3, 3], atol=0.03)
    assert np.abs(read_points(placed / "calibration" / "colmap").xyz).max() < 100
    assert "EPSG:25832 less (441000, 5412000, 300), m" in (
        (placed / "calibration" / "sparse_pc.ply").read_bytes()[:400].decode("ascii", "replace")
    )


def test_a_survey_stays_until_it_is_forgotten(placed: Path) -> None:
    from calib.evidence import _control

    session = Session.open(placed)
    earlier = read_calibration(placed)
    before = earlier.coordinates
    again = _control(session, CalibrationRequest(), earlier)
    assert before is not None
    assert again is not None
    assert list(again.survey.points) == [point.name for point in before.points]
    assert again.survey.system == "EPSG:25832"
    assert sum(map(len, again.marks.values())) == sum(len(point.marks) for point in before.points)
    assert _control(session, CalibrationRequest(survey="none"), earlier) is None


def test_a_survey_that_does_not_fit_leaves_the_scene_in_its_own_coordinates(
    unsurveyed: Path, staked: Staked, tmp_path: Path
) -> None:
    session = Path(shutil.copytree(unsurveyed, tmp_path / "session"))
    few = dict(list(staked.places.items())[:4])
    few["P0"], few["P1"] = few["P1"], few["P0"]
    points = write_points(tmp_path / "points.csv", few)
    marks = write_marks(
        tmp_path / "marks.csv", {n: by_view for n, by_view in staked.marks(CLICK).items() if n in few}
    )
    with even_light(), pytest.raises(PartialError, match=r"arbitrary coordinates.*exchanged"):
        calibrate(session, CalibrationRequest(only="poses", survey=points, marks=marks))
    record = read_calibration(session)
    assert len(record.views) == 12
    assert (record.unit, record.coordinates) == ("relative", None)
    with pytest.raises(InputError, match="--survey and --onto place poses"):
        calibrate(session, CalibrationRequest(only="colour", survey=points, marks=marks))
