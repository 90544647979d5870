"""A body that writes RAW and JPEG: both are kept as they came, captured or imported."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from capture.check.check import check, repair
from capture.imports.photos import import_photos
from capture.simulated import capture_simulated
from drivers.sim.ptp.profiles import PROFILES
from imaging.files import store
from imaging.session.session import Session


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One frame of the toy rig, two cameras of three exposures; not to be changed."""
    folder = tmp_path_factory.mktemp("originals") / "captured"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PROFILES, "generic", replace(PROFILES["generic"], jpeg=True))
        capture_simulated("toy", folder, seed=3, frames=1)
    return folder


def test_the_jpeg_lies_beside_the_raw_file_hashed_and_is_no_shot_of_its_own(captured: Path) -> None:
    shots = Session.open(captured).shots()
    assert len(shots) == 6
    for shot in shots:
        assert shot.file.endswith(".dng")
        assert shot.developed == f"{shot.file.removesuffix('.dng')}.jpg"
        assert (captured / shot.developed).read_bytes()[:2] == b"\xff\xd8"
        assert store.sha256(captured / shot.developed) == shot.developed_sha256
    assert check(captured).ok


def test_a_session_imported_from_the_files_of_a_captured_one_holds_the_same(
    captured: Path, tmp_path: Path
) -> None:
    result = import_photos(captured / "raw", tmp_path / "imported", bracket=3)
    assert any("6 files kept beside RAW files" in guess for guess in result.guesses)
    same = ("sha256", "developed_sha256", "width", "height", "reported", "captured_at")
    both = []
    for folder in (captured, tmp_path / "imported"):
        shots = sorted(Session.open(folder).shots(), key=lambda shot: shot.sha256)
        assert all((folder / shot.file).is_file() for shot in shots)
        assert all((folder / str(shot.developed)).is_file() for shot in shots)
        both.append([[getattr(shot, name) for name in same] for shot in shots])
    assert both[0] == both[1]
    assert check(tmp_path / "imported").ok


def test_what_became_of_the_jpegs_is_told_and_repaired(captured: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(captured, tmp_path / "session"))
    first, second, third, *_ = (shot.developed for shot in Session.open(folder).shots())
    (folder / first).unlink()
    (folder / second).write_bytes(b"another")
    problems = {problem.file: problem.kind for problem in check(folder).problems}
    assert problems == {first: "absent", second: "altered"}
    index = folder / "shots.jsonl"
    lines = [json.loads(line) for line in index.read_text().splitlines()]
    for line in lines:
        if line["developed"] == third:
            del line["developed"], line["developed_sha256"]
    index.write_text("".join(f"{json.dumps(line)}\n" for line in lines[:-1]))
    report = repair(folder)
    assert report.unrepaired == ()
    assert len(report.added) == 1
    shots = Session.open(folder).shots()
    assert len(shots) == 6
    assert [shot.developed for shot in shots].count(None) == 1
    assert [problem.file for problem in check(folder).problems] == [second]
