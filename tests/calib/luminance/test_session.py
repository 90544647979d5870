"""A session whose wall has cards of known luminance: its scale, what becomes of it, and refusals."""

import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from calib.calibrate import calibrate
from calib.luminance.area import LUMINANCE, area_light
from calib.luminance.measure import FALLOFF_UNKNOWN
from imaging.colour.spaces import REC709_FROM_XYZ, srgb_encode
from imaging.errors import CalibrationError, PartialError
from imaging.optics.exposure import Exposure
from imaging.optics.pose import Pose
from imaging.plates.merged_view import view_light
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import as_matrix
from imaging.session.calibration import (
    CalibrationRecord,
    CameraCalibration,
    Response,
    ViewCalibration,
    read_calibration,
)
from imaging.session.luminance import LuminanceReading
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from tests.calib.colour.charts import photograph
from tests.calib.conftest import make_session

WIDTH, HEIGHT = 120, 80
COLOUR = np.array([[0.50, 0.17, 0.03], [0.16, 0.72, 0.12], [0.02, 0.18, 0.56]])
TIMES = (1 / 64, 1 / 8, 1.0)
CANDELAS = 37.0
"""cd/m2 of a signal of 1 in a second at f/1 and ISO 100."""
CARDS = {
    (50, 30, 20, 20): (0.5, 0.5, 0.5),
    (26, 30, 20, 20): (8.0, 5.0, 2.0),
    (74, 30, 20, 20): (0.1, 0.2, 0.4),
}
LAMP, EDGE = (4, 4, 12, 12), (40, 40, 20, 20)


def wall() -> np.ndarray:
    """Linear Rec.709 [H, W, 3]: a slope of light, cards, and a lamp that saturates."""
    light = np.repeat(np.linspace(0.05, 0.6, WIDTH)[None, :, None], HEIGHT, 0).repeat(3, 2)
    for (left, top, width, height), colour in {**CARDS, LAMP: (90.0, 90.0, 90.0)}.items():
        light[top : top + height, left : left + width] = colour
    return light


def views(files: np.ndarray | None = COLOUR, sees: np.ndarray = COLOUR, cfa: Cfa = Cfa.RGGB) -> list:
    named = None if files is None else as_matrix(files @ REC709_FROM_XYZ)
    light = wall() @ sees.T
    return [
        [
            (
                photograph(light, time, seed=10 * frame + step, cfa=cfa, camera_from_xyz=named, time=time),
                Exposure(time=time, f_number=1.0, iso=100.0),
            )
            for step, time in enumerate(TIMES)
        ]
        for frame in range(2)
    ]


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of one camera; not to be changed."""
    folder = make_session(tmp_path_factory.mktemp("luminance") / "session", views())
    calibrate(folder, only="response")
    return folder


@pytest.fixture
def session(bare: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(bare, tmp_path / "session"))


def spot(area: tuple[int, int, int, int], off: float = 1.0, **stated: object) -> LuminanceReading:
    """Reading of a meter off a card, wrong by a factor."""
    true = CANDELAS * float(LUMINANCE @ np.array(CARDS.get(area, (1.0, 1.0, 1.0))))
    fields = {"view": "0000/cam", "luminance": off * true, "error": 0.03, "source": "spot"} | stated
    return LuminanceReading(area=area, **fields)


def value_of(record: CalibrationRecord) -> float:
    assert record.luminance is not None
    return record.luminance.value


@pytest.mark.parametrize("area", CARDS)
def test_any_card_gives_the_scale_whatever_its_exposure_and_colour(
    area: tuple[int, int, int, int], session: Path
) -> None:
    record = calibrate(session, only="luminance", luminance=[spot(area)])
    assert value_of(record) == pytest.approx(CANDELAS, rel=0.01)
    rung = next(rung for rung in record.rungs if rung.name == "luminance")
    assert rung.taken
    assert (rung.gain, rung.standard_error) == (record.luminance.value, record.luminance.error)


def test_photosites_without_a_filter_change_nothing(tmp_path: Path) -> None:
    four = np.concatenate([COLOUR, COLOUR.sum(0, keepdims=True)])
    folder = make_session(tmp_path / "session", views(four, four, Cfa.of("RG/BW")))
    record = calibrate(folder, only="response", luminance=[spot(next(iter(CARDS)))])
    assert len(record.cameras[0].camera_from_rec709 or ()) == 4
    assert value_of(record) == pytest.approx(CANDELAS, rel=0.01)


def test_lux_on_a_grey_card_is_the_same(session: Path) -> None:
    (area, *_), lux = CARDS, 0.5 * CANDELAS * np.pi / 0.18
    card = spot(area, luminance=None, illuminance=lux, reflectance=0.18, source="light meter")
    assert value_of(calibrate(session, only="luminance", luminance=[card])) == pytest.approx(
        CANDELAS, rel=0.01
    )


def test_the_error_is_the_meters_and_what_is_not_known_of_the_lens(session: Path) -> None:
    middle, side, _ = CARDS
    scales = [
        calibrate(session, only="luminance", luminance=[spot(area)]).luminance for area in (middle, side)
    ]
    assert scales[0].error / scales[0].value == pytest.approx(np.hypot(0.03, 0.01), rel=0.1)
    radius = np.hypot(36 - WIDTH / 2, 40 - HEIGHT / 2) / np.hypot(WIDTH / 2, HEIGHT / 2)
    light = scales[1].readings[0].light_error
    assert light == pytest.approx(np.hypot(0.01, FALLOFF_UNKNOWN * radius**2), rel=0.1)


def test_readings_stay_until_they_are_forgotten(session: Path) -> None:
    readings = [spot(area, off) for area, off in zip(CARDS, (1.01, 0.99, 1.0), strict=True)]
    first = calibrate(session, only="luminance", luminance=readings).luminance
    again = calibrate(session, only="response")
    assert again.luminance == first
    assert read_calibration(session).luminance == first
    assert calibrate(session, only="luminance", luminance=()).luminance is None
    record = calibrate(session, only="response")
    assert record.luminance is None
    assert not any(rung.name == "luminance" for rung in record.rungs)


def test_a_reading_of_pictures_that_were_taken_again_is_lost_and_said_to_be(session: Path) -> None:
    calibrate(session, only="luminance", luminance=[spot(next(iter(CARDS)))])
    opened = Session.open(session)
    first, second = ([shot for shot in opened.shots() if shot.frame == frame] for frame in (0, 1))
    for shot, other in zip(first, second, strict=True):
        fields = {"file": other.file, "sha256": other.sha256}
        opened.append_shot(ShotRecord.model_validate(shot.model_dump() | fields))
    with pytest.raises(PartialError, match="no view has a pose"):
        calibrate(session)
    record = read_calibration(session)
    assert record.luminance is None
    (lost,) = (rung for rung in record.rungs if rung.name == "luminance")
    assert not lost.taken
    assert lost.reason.startswith("the shots of 0000/cam, where the reading was taken, have changed")


REFUSED: dict[str, tuple[Callable[[], LuminanceReading], str]] = {
    "saturated": (lambda: spot(LAMP), "saturated in every exposure: take a shorter one"),
    "uneven": (lambda: spot(EDGE, view="0001/cam"), "too uneven: mark an area"),
    "small": (lambda: spot((50, 30, 6, 6)), "too small: mark an even area of 36 pixels"),
    "beyond": (lambda: spot((110, 30, 20, 20)), "reaches beyond the picture, which has 120x80 pixels"),
    "no view": (lambda: spot((50, 30, 20, 20), view="0007/cam"), "has no shot of the scene of 0007/cam"),
    "no chart": (
        lambda: LuminanceReading(illuminance=500.0, error=0.05, source="light meter"),
        "no camera of the calibration saw a colour chart: add --chart",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_tells_no_luminance_is_refused_and_nothing_written(name: str, bare: Path) -> None:
    reading, message = REFUSED[name]
    before = (bare / "calibration" / "calibration.json").read_bytes()
    with pytest.raises(CalibrationError, match=message):
        calibrate(bare, only="luminance", luminance=[reading()])
    assert (bare / "calibration" / "calibration.json").read_bytes() == before


def test_a_camera_of_unknown_colour_has_no_luminance(tmp_path: Path) -> None:
    folder = make_session(tmp_path / "session", views(files=None)[:1])
    with pytest.raises(PartialError, match=r"response is calibrated.* the colour of camera cam is not known"):
        calibrate(folder, only="response", luminance=[spot(next(iter(CARDS)))])
    assert read_calibration(folder).luminance is None


def test_the_white_balance_of_a_photograph_changes_no_reading(tmp_path: Path) -> None:
    balances, light = [(1.0, 1.0, 1.0), (1.35, 1.0, 0.6)], np.array([0.4, 0.3, 0.2])
    exposure = Exposure(time=1.0, f_number=1.0, iso=100.0)
    photographs = [
        np.rint(255 * srgb_encode(np.ones((80, 120, 1)) * light * gains)).astype(np.uint8)
        for gains in balances
    ]
    session = Session.open(make_session(tmp_path / "session", [[(one, exposure)] for one in photographs]))
    still = Pose(quaternion=(1.0, 0.0, 0.0, 0.0), translation=(0.0, 0.0, 0.0))
    record = CalibrationRecord(
        created=datetime.now(UTC),
        versions={},
        shots_sha256="",
        cameras=(CameraCalibration(name="cam", serial="cam", response=Response(kind="srgb", evidence="")),),
        views=tuple(
            ViewCalibration(camera="cam", frame=frame, cam_from_world=still, white_balance=gains, points=9)
            for frame, gains in enumerate(balances)
        ),
        exposure_scale={shot.file: 1.0 for shot in session.shots("scene")},
    )
    for view, shots in brackets(session.shots("scene")).items():
        written = view_light(session, view, shots, record).picture.light[30:54, 40:64].mean(axis=(0, 1))
        read = area_light(session, record, view, (40, 30, 24, 24)).light
        assert read == pytest.approx(float(LUMINANCE @ light), rel=0.02)
        assert read == pytest.approx(float(LUMINANCE @ written), rel=1e-4)
