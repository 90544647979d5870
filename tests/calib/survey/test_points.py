"""Tables of surveyed points and of marks: what they may say, and one sentence for what they may not."""

from pathlib import Path

import numpy as np
import pytest

from calib.measures import require_usable
from calib.request import CalibrationRequest
from calib.survey.control_points import read_control
from calib.survey.marks import read_marks
from calib.survey.points import ENU, read_survey
from imaging.errors import InputError
from imaging.session.session import Session
from imaging.session.view_id import ViewId


def message(path: Path, text: str | bytes) -> str:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as error:
        read_survey(path)
    message = str(error.value)
    assert "\n" not in message
    assert str(path) in message
    return message


GOOD = "name,x,y,z\nA,0,0,0\nB,1,0,0\nC,0,2,0\n"


def test_columns_are_found_by_their_names(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("# EPSG:25832\nsigma;height;name;northing;easting\n0,01;300,5;A;5412000,25;441000\n"
                    ";301;B;5412001;441000\n;300;C;5412000;441003\n")  # fmt: skip
    survey = read_survey(path)
    assert survey.system == "EPSG:25832"
    assert survey.points["A"].position == (441000.0, 5412000.25, 300.5)
    assert (survey.points["A"].sigma, survey.points["B"].sigma) == (0.01, None)
    assert survey.offset == (441000.0, 5412000.0, 300.0)


@pytest.mark.parametrize("mark", [";", "\t"])
def test_names_have_commas_and_numbers_decimal_commas_beside_other_separators(
    arm: Path, tmp_path: Path, mark: str
) -> None:
    points, marks = tmp_path / "points.csv", tmp_path / "marks.csv"
    points.write_text("name;x;y;z\nBell, north;1,5;0;0\nB;1;0;0\nC;0;2;0\n".replace(";", mark))
    survey = read_survey(points)
    assert list(survey.points) == ["Bell, north", "B", "C"]
    assert survey.points["Bell, north"].position == (1.5, 0.0, 0.0)
    marks.write_text("name;image;u;v\nBell, north;0001/cam2;12,5;30\n".replace(";", mark))
    read = read_marks(marks, Session.open(arm), survey.points)
    assert read["Bell, north"][ViewId(1, "cam2")].at == (12.5, 30.0)


def test_commas_separate_where_they_are_separators(tmp_path: Path) -> None:
    assert "line 3" in message(tmp_path / "points.csv", GOOD.replace("B,1", 'B,"1,5"'))


def test_small_coordinates_stay_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text(GOOD)
    survey = read_survey(path)
    assert (survey.system, survey.offset) == ("local", (0.0, 0.0, 0.0))


def test_latitudes_become_metres(tmp_path: Path) -> None:
    """Against the lengths of degrees on the ellipsoid by its radii of curvature."""
    path = tmp_path / "points.csv"
    step = 1e-3
    path.write_text(
        f"name,lat,lon,alt\nA,48,11,500\nB,{48 + step},11,500\nC,48,{11 + step},500\nD,48,11,510\n"
    )
    survey = read_survey(path)
    assert survey.system == ENU
    a, b, c, d = (np.array(survey.points[name].position) for name in "ABCD")
    major, squared = 6378137.0, 6.69437999014e-3
    down = 1 - squared * np.sin(np.radians(48.0005)) ** 2
    north = np.radians(step) * (major * (1 - squared) / down**1.5 + 500)
    east = np.radians(step) * (major / np.sqrt(1 - squared * np.sin(np.radians(48.0)) ** 2) + 500)
    east *= np.cos(np.radians(48.0))
    np.testing.assert_allclose(np.linalg.norm(b - a), north, rtol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(c - a), east, rtol=1e-7)
    np.testing.assert_allclose(d - a, (0, 0, 10), atol=1e-3)
    assert (b - a)[1] > 100
    assert (c - a)[0] > 70


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no heading"),
        ("A,0,0,0\nB,1,0,0\n", "no heading"),
        ("name,x,y,z\nA,0,0\n", "line 2"),
        (GOOD.replace("B,1", "B,one"), "line 3"),
        (GOOD.replace("B,1", "B,nan"), "line 3"),
        (GOOD.replace("B,", "A,"), "there twice"),
        (GOOD.replace("B,", ","), "missing"),
        ("name,x,y,z\nA,0,0,0\n", "has 1 points"),
        ("name,x,y,z,sigma\nA,0,0,0,-1\n", "sigma"),
        ("name,lat,lon,alt\nA,111,48,0\n", "exchanged"),
        (GOOD.encode("utf-16"), "UTF-8"),
        (b"\x89PNG\0\1\2", "UTF-8"),
        (b"name,x,y,z\nA,0,0\0,0\n", "not a text file"),
        ('name,x,y,z\n"A"b,0,0,0\n', "quotes"),
    ],
)
def test_a_damaged_table_is_one_sentence(tmp_path: Path, text: str | bytes, words: str) -> None:
    assert words in message(tmp_path / "points.csv", text)


def test_no_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_survey(tmp_path / "none.csv")


def test_images_are_known_by_view_and_by_name(arm: Path, tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    session = Session.open(arm)
    file = next(shot.file for shot in session.shots("scene") if shot.view == ViewId(0, "cam0"))
    path.write_text(f"name,image,u,v\nA,0001/cam2,12.5,30\nA,{file},1,2\n")
    marks = read_marks(path, session, ["A"])
    assert marks["A"][ViewId(1, "cam2")].at == (12.5, 30.0)
    assert marks["A"][ViewId(0, "cam0")].at == (1.0, 2.0)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("A,0001/cam2,12.5", "line 2"),
        ("B,0001/cam2,1,2", "no point 'B'"),
        ("A,0009/cam2,1,2", "no image is called '0009/cam2'"),
        ("A,0001/cam2,1,240.5", "outside"),
        ("A,0001/cam2,1,2\nA,0001/cam2,1,3", "already"),
        ("", "no marks"),
    ],
)
def test_marks_that_cannot_be_are_one_sentence(arm: Path, tmp_path: Path, line: str, words: str) -> None:
    path = tmp_path / "marks.csv"
    path.write_text(f"name,image,u,v\n{line}\n")
    with pytest.raises(InputError) as error:
        read_marks(path, Session.open(arm), ["A"])
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_marks_and_points_belong_together(arm: Path, tmp_path: Path) -> None:
    session, points = Session.open(arm), tmp_path / "points.csv"
    points.write_text(GOOD)
    for request in (
        CalibrationRequest(marks=points),
        CalibrationRequest(markers="DICT_4X4_50", onto=arm),
        CalibrationRequest(markers="DICT_4X4_50", survey="none"),
    ):
        with pytest.raises(InputError, match="--survey FILE"):
            require_usable(request)
    with pytest.raises(InputError, match="--marks"):
        read_control(session, points, None, None)
    with pytest.raises(InputError, match="number of a marker"):
        read_control(session, points, None, "DICT_4X4_50")
    points.write_text(GOOD.replace("A,", "7,"))
    with pytest.raises(InputError, match="no markers"):
        read_control(session, points, None, "DICT_9X9")
    control = read_control(session, points, None, "apriltag_36h11")
    assert control is not None
    assert control.dictionary is not None
    assert control.dictionary.upper() == "DICT_APRILTAG_36H11"
