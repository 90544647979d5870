"""What becomes of a calibration that is stopped, killed, or begun twice."""

import hashlib
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from calib.adjustment.bundle_adjustment import Free
from calib.calibrate import calibrate
from calib.data.matching import match
from calib.data.unfinished import FOLDER
from calib.light.radiometry import light_of
from calib.view_images import ViewSummary
from imaging.errors import CalibrationError, InputError
from imaging.files import store
from imaging.progress import unreported
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.lock import sole_calibrator
from imaging.session.view_id import ViewId
from tests.calib.conftest import even_light, make_session


def bytes_of(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


class Stopped(Exception):
    """Interruption raised in the middle of things."""


class Undisturbed(NamedTuple):
    """Result of a calibration that nothing stopped, and the steps that it reported."""

    record: CalibrationRecord
    messages: set[str]


@pytest.fixture(scope="module")
def six(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of six views, of three cameras of the arm; copy it before changing it."""
    session = Path(shutil.copytree(arm, tmp_path_factory.mktemp("six") / "session"))
    shots = store.read_lines(session / "shots.jsonl")
    (session / "shots.jsonl").unlink()
    for shot in shots:
        if shot["camera"] != "cam3" and shot["frame"] < 2:
            store.append_line(session / "shots.jsonl", shot)
    return session


@contextmanager
def known(session: Path, looks: Mapping[ViewId, ViewSummary]) -> Iterator[None]:
    """All of the six views is known that comes before their poses, and the lenses are plain."""
    record = read_calibration(session)
    with even_light(), pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.view_images.summarise", lambda session, view, *rest: looks[view.id])
        patch.setattr("calib.light.radiometry.measure_light", lambda *rest: light_of(record, ()))
        patch.setattr("calib.poses.adjusted.climb", lambda *rest: (Free(), ()))
        yield


@pytest.fixture
def all_known(six: Path, arm_looks: dict[ViewId, ViewSummary]) -> Iterator[None]:
    with known(six, arm_looks):
        yield


@pytest.fixture(scope="module")
def undisturbed(
    six: Path, arm_looks: dict[ViewId, ViewSummary], tmp_path_factory: pytest.TempPathFactory
) -> Undisturbed:
    """What becomes of the six views where nothing goes wrong."""
    session = Path(shutil.copytree(six, tmp_path_factory.mktemp("undisturbed") / "session"))
    messages: set[str] = set()
    with known(six, arm_looks):
        record = calibrate(session, on_progress=lambda message, done, total: messages.add(message))
    return Undisturbed(record, messages)


@pytest.fixture(scope="module")
def stopped(
    six: Path, arm_looks: dict[ViewId, ViewSummary], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The six views, whose calibration was stopped when all of them were placed."""
    session = Path(shutil.copytree(six, tmp_path_factory.mktemp("stopped") / "session"))

    def stop(message: str, done: int, total: int) -> None:
        if message == "measuring how sure it is":
            raise KeyboardInterrupt

    with known(six, arm_looks), pytest.raises(KeyboardInterrupt):
        calibrate(session, on_progress=stop)
    return session


def bytes_but_unfinished(session: Path) -> dict[str, str]:
    return {file: digest for file, digest in bytes_of(session).items() if not file.startswith(FOLDER)}


@pytest.mark.usefixtures("all_known")
@pytest.mark.parametrize(
    ("begun", "stage", "error"),
    [("six", "placing views", KeyboardInterrupt), ("stopped", "writing the calibration", Stopped)],
)
def test_stopped_half_way_the_old_calibration_stays(
    begun: str, stage: str, error: type[BaseException], request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """A callback from inside the mapper is stopped as well: that is where Ctrl-C is noticed."""
    session = Path(shutil.copytree(request.getfixturevalue(begun), tmp_path / "session"))
    before = bytes_but_unfinished(session)

    def stop(message: str, done: int, total: int) -> None:
        if message == stage and (done > 0 or not stage.startswith("placing")):
            raise error

    with pytest.raises(error):
        calibrate(session, on_progress=stop)
    assert bytes_but_unfinished(session) == before
    assert list(session.glob(".*")) == [session / FOLDER]


@pytest.mark.usefixtures("all_known")
def test_a_stopped_calibration_goes_on_and_ends_as_an_undisturbed_one(
    six: Path, undisturbed: Undisturbed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A camera without a shot is in it, with nothing known."""
    session = Path(shutil.copytree(six, tmp_path / "session"))
    matched: list[int] = []

    def counted(one: np.ndarray, other: np.ndarray, *, by_bytes: bool) -> np.ndarray:
        matched.append(len(one))
        return match(one, other, by_bytes=by_bytes)

    def stop(message: str, done: int, total: int) -> None:
        if (message, done) == ("matching", 9):
            raise KeyboardInterrupt

    monkeypatch.setattr("calib.data.features.match", counted)
    with pytest.raises(KeyboardInterrupt):
        calibrate(session, on_progress=stop)
    before = len(matched)  # and perhaps some more, ahead of the nine that are kept
    assert before >= 9
    record = calibrate(session, on_progress=unreported)
    assert len(matched) == before + 6  # of the fifteen pairs of six views
    assert not list(session.glob(".*"))
    assert len(record.views) == 6
    assert record.model_copy(update={"created": undisturbed.record.created}) == undisturbed.record
    assert record.camera("cam3").lens is None
    assert record.camera("cam3").cam_from_rig is None
    assert {view.camera for view in record.views} == {"cam0", "cam1", "cam2"}


@pytest.mark.usefixtures("all_known")
def test_killed_after_the_poses_it_does_not_place_the_views_again(
    stopped: Path, undisturbed: Undisturbed, tmp_path: Path
) -> None:
    session = Path(shutil.copytree(stopped, tmp_path / "session"))
    messages: set[str] = set()
    record = calibrate(session, on_progress=lambda message, done, total: messages.add(message))
    assert messages.isdisjoint({"placing views", "adjusting", "aligning patches"})
    assert undisturbed.messages >= {"placing views", "adjusting", "aligning patches"}
    assert record.model_copy(update={"created": undisturbed.record.created}) == undisturbed.record


def test_a_session_that_is_being_calibrated_is_refused(tmp_path: Path) -> None:
    picture = np.full((8, 8, 3), 90, dtype=np.uint8)
    session = make_session(tmp_path / "s", [[(picture, None)]])
    with sole_calibrator(session), pytest.raises(InputError, match="calibration is being made by"):
        calibrate(session)
    with pytest.raises(CalibrationError):
        calibrate(session)
