import errno
import json
from pathlib import Path

import pytest

from capture.bracket.goals import BracketGoals
from capture.record.shooting import rehearse
from capture.request import CaptureRequest
from capture.simulated import capture_simulated, simulated_source
from drivers.sim.faults import ROUGH
from imaging.errors import CaptureError, InputError, StorageError
from imaging.files import store
from imaging.files.raw import read_raw
from imaging.session.session import Session, brackets
from tests.trees import tree


@pytest.fixture(scope="module")
def toy(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("toy") / "session"
    capture_simulated("toy", out, seed=3)
    return out


def cut(session: Path, keep: int) -> None:
    """Cut the session as if the capture had been killed after `keep` shots and half of the next."""
    index = session / "shots.jsonl"
    lines = index.read_bytes().splitlines(keepends=True)
    for line in lines[keep + 1 :]:
        (session / json.loads(line)["file"]).unlink()
    index.write_bytes(b"".join(lines[:keep]))
    (session / "truth" / "truth.json").unlink()


def copy(session: Path, to: Path) -> Path:
    for name, data in tree(session).items():
        (to / name).parent.mkdir(parents=True, exist_ok=True)
        (to / name).write_bytes(data)
    return to


def test_a_toy_session_is_complete(toy):
    session = Session.open(toy)
    assert (session.record.origin, session.record.seed) == ("sim:toy", 3)
    assert [camera.kind for camera in session.record.cameras] == ["raw", "raw"]
    groups = brackets(session.shots("scene"))
    assert len(groups) == 6
    for group in groups.values():
        assert [s.step for s in group] == [0, 1, 2]
        levels = [read_raw(session.file(s)).signal().mean() for s in group]
        assert [s.requested.time for s in group] == sorted(s.requested.time for s in group)
        assert levels == sorted(levels)
        assert levels[2] > 3 * levels[1]
    truth = json.loads((toy / "truth" / "truth.json").read_text())
    assert len(truth["exposures"]) == 18
    assert len(list((toy / "truth").rglob("*.exr"))) == 6


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(toy, tmp_path):
    capture_simulated("toy", tmp_path / "same", seed=3)
    capture_simulated("toy", tmp_path / "other", seed=4)
    assert tree(tmp_path / "same" / "raw") == tree(toy / "raw")
    other = tree(tmp_path / "other" / "raw")
    assert all(other[name] != data for name, data in tree(toy / "raw").items())


@pytest.mark.parametrize("keep", [0, 1, 5, 17])
def test_resume_gives_the_bytes_of_a_capture_that_was_never_interrupted(toy, tmp_path, keep):
    broken = copy(toy, tmp_path / "broken")
    cut(broken, keep)
    result = capture_simulated("toy", broken, seed=3, resume=True)
    assert (result.taken, result.earlier) == (18 - keep, keep)
    assert tree(broken / "raw") == tree(toy / "raw")
    assert tree(broken / "truth") == tree(toy / "truth")


def test_resume_of_a_finished_session_changes_nothing(toy, tmp_path):
    again = copy(toy, tmp_path / "again")
    result = capture_simulated("toy", again, seed=3, resume=True)
    assert (result.taken, result.earlier) == (0, 18)
    assert tree(again) == tree(toy)


def test_truth_that_is_missing_is_written_and_truth_of_fewer_shots_is_written_anew(toy, tmp_path):
    again = copy(toy, tmp_path / "again")
    (again / "truth" / "truth.json").unlink()
    capture_simulated("toy", again, seed=3, resume=True)
    assert tree(again) == tree(toy)
    truth = json.loads((again / "truth" / "truth.json").read_text())
    truth["exposures"].pop()
    (again / "truth" / "truth.json").write_text(json.dumps(truth))
    (again / "raw" / "0002" / "cam1_2.dng").unlink()
    capture_simulated("toy", again, seed=3, resume=True)
    assert tree(again / "truth") == tree(toy / "truth")


def test_frames_and_stops_can_be_chosen_and_resume_takes_them_from_the_session(tmp_path):
    out = tmp_path / "s"
    result = capture_simulated("toy", out, frames=2, bracket=(-2, 0, 1, 2.5))
    assert result.planned == 16
    session = Session.open(out)
    times = [exposure.time for exposure in session.plans()[0].bracket]
    assert times == [1 / 250, 1 / 60, 1 / 30, 1 / 10]
    cut(out, 7)
    assert capture_simulated("toy", out, resume=True).taken == 9
    assert len(session.shots()) == 16


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"name": "toy-ldr"}, "captured from sim:toy, not sim:toy-ldr"),
        ({"seed": 4}, "captured with seed 3, not 4"),
        ({"frames": 2}, "planned with 3 frames, not 2"),
        ({"bracket": (0.0,)}, "planned with the bracket 1/1000 s f/4 ISO 100, 1/60 s"),
    ],
)
def test_resume_with_another_plan_is_refused(toy, changed, sentence):
    before = tree(toy)
    with pytest.raises(InputError, match=sentence):
        capture_simulated(changed.pop("name", "toy"), toy, **{"seed": 3, "resume": True} | changed)
    assert tree(toy) == before


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"name": "nonesuch"}, "no simulated rig 'nonesuch'"),
        ({"frames": 0}, "has 3 positions, not 0"),
        ({"frames": 4}, "has 3 positions, not 4"),
        ({"bracket": ()}, "the bracket is empty"),
        ({"bracket": (0, 0.01)}, "a second time"),
        ({"bracket": (0, 12)}, "out of reach"),
        ({"bracket": (float("nan"),)}, "not an exposure"),
        ({"resume": True}, "is not a folder"),
    ],
)
def test_what_cannot_be_captured_is_said_and_leaves_nothing(tmp_path, options, sentence):
    with pytest.raises(InputError, match=sentence):
        capture_simulated(options.pop("name", "toy"), tmp_path / "a" / "b", **options)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_something_in_it_is_not_touched(toy, tmp_path):
    before = tree(toy)
    with pytest.raises(InputError, match="not empty"):
        capture_simulated("toy", toy, seed=3)
    assert tree(toy) == before
    (tmp_path / "notes.txt").write_text("mine")
    for resume in (False, True):
        with pytest.raises(InputError):
            capture_simulated("toy", tmp_path, resume=resume)
    assert tree(tmp_path) == {"notes.txt": b"mine"}
    file = tmp_path / "notes.txt"
    with pytest.raises(InputError):
        capture_simulated("toy", file)


def test_resume_begins_where_a_kill_came_before_the_session_was_named(toy, tmp_path):
    out = tmp_path / "s"
    out.mkdir()
    (out / ".session.json.part").write_bytes(b'{"schema')
    capture_simulated("toy", out, seed=3, resume=True)
    assert tree(out / "raw") == tree(toy / "raw")
    assert not list(out.rglob(".*.part"))


def test_two_captures_into_one_folder_do_not_mix(tmp_path):
    out = tmp_path / "s"
    errors = []

    def second_capture(message, done, total):
        for resume in (False, True):
            with pytest.raises(InputError) as caught:
                capture_simulated("toy", out, seed=3, resume=resume)
            errors.append(str(caught.value))

    capture_simulated("toy", out, seed=3, frames=1, on_progress=second_capture)
    assert errors
    assert all("being written by another rig" in error for error in errors)
    assert len(Session.open(out).shots()) == 6
    assert capture_simulated("toy", out, seed=3, frames=1, resume=True).earlier == 6


@pytest.mark.parametrize("code", [errno.EROFS, errno.ENOSPC])
def test_a_target_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch, code):
    def refuse(path):
        raise OSError(code, "refused")

    monkeypatch.setattr(store, "sync", refuse)
    with pytest.raises(StorageError):
        capture_simulated("toy", tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []


def test_plans_that_the_rig_cannot_shoot_are_refused(toy, tmp_path):
    broken = copy(toy, tmp_path / "broken")
    plan = json.loads((broken / "plans.jsonl").read_text())
    for change in ({"frames": [0, 7]}, {"cameras": ["cam9"]}, {"bracket": [None]}):
        (broken / "plans.jsonl").write_text(json.dumps(plan | change) + "\n")
        with pytest.raises(InputError, match=r"plans\.jsonl plans shots that the rig cannot take"):
            capture_simulated("toy", broken, seed=3, resume=True)


def test_shots_without_their_plan_are_not_planned_anew(toy, tmp_path):
    lost = copy(toy, tmp_path / "lost")
    (lost / "plans.jsonl").unlink()
    before = tree(lost)
    words = r"plans\.jsonl lacks the plan of its 18 scene shots: restore it from a copy\."
    with pytest.raises(InputError, match=words):
        capture_simulated("toy", lost, seed=3, resume=True)
    with simulated_source("toy", seed=3) as source, pytest.raises(InputError, match=words):
        rehearse(source, lost, CaptureRequest(resume=True))
    assert tree(lost) == before


def test_an_automatic_bracket_is_that_of_the_rehearsal_and_says_why(tmp_path):
    wanted = BracketGoals(snr=20.0, slowest=1 / 4)
    said: list[str] = []
    with simulated_source("toy", seed=3) as source:
        request = CaptureRequest(bracket=wanted)
        rehearsed = rehearse(source, tmp_path / "s", request, progress=lambda line, *_: said.append(line))
    assert list(tmp_path.iterdir()) == []
    assert rehearsed.metering is not None
    assert said[0] == "planning"
    assert len(said) == 1 + len(rehearsed.metering.probes)
    for probe in rehearsed.metering.probes:
        assert sum(line.startswith("metering, probe") and line.endswith(str(probe)) for line in said) == 1
    out = tmp_path / "s"
    result = capture_simulated("toy", out, seed=3, bracket=wanted)
    plan = Session.open(out).plans()[0]
    assert plan.bracket == rehearsed.record.bracket
    assert plan.reason == rehearsed.record.reason
    assert result.planned == 6 * len(plan.bracket)
    assert max(exposure.time for exposure in plan.bracket) == 1 / 4
    assert "fewest exposures for 20 dB within slowest 0.25 s" in plan.reason
    assert "cam0 R: the dark end lacks" in plan.reason
    # The meter's own shots leave no trace in the frames: without them they have the same bytes.
    before = tree(out)
    cut(out, 4)
    with pytest.raises(InputError, match=r"planned with the bracket auto, snr 20, slowest 0\.25 \(.*snr 30"):
        capture_simulated("toy", out, seed=3, bracket=BracketGoals(snr=30.0), resume=True)
    again = capture_simulated("toy", out, seed=3, bracket=wanted, resume=True)
    assert (again.earlier, again.missing) == (4, ())
    assert Session.open(out).plans() == [plan]
    assert tree(out / "raw") == {n[4:]: data for n, data in before.items() if n.startswith("raw/")}


def test_a_scene_that_cannot_be_metered_leaves_nothing(tmp_path):
    with pytest.raises(CaptureError, match="55 dB are out of the reach of cam0"):
        capture_simulated("toy", tmp_path / "a", bracket=BracketGoals(snr=55.0))
    assert list(tmp_path.iterdir()) == []


def test_photographs_of_a_rig_that_develops_them_are_stored_as_received(tmp_path):
    result = capture_simulated("toy-ldr", tmp_path / "s", frames=1)
    session = Session.open(tmp_path / "s")
    assert result.planned == 10
    assert {session.file(s).suffix for s in session.shots()} == {".jpg"}
    assert {camera.kind for camera in session.record.cameras} == {"ldr"}


def test_a_rough_bus_costs_no_shot_and_what_happened_is_listed(toy, tmp_path):
    """Every file holds what it holds on a quiet bus, but for shots that had to be taken again."""
    out = tmp_path / "s"
    result = capture_simulated("toy", out, seed=3, mix=ROUGH)
    assert (result.taken, result.missing, result.problems) == (18, (), ())
    happened = [json.loads(line) for line in (out / "truth" / "faults.jsonl").read_text().splitlines()]
    assert happened
    assert {"time", "serial", "operation", "nth", "fault"} == set(happened[0])
    again = {shot.file for shot in Session.open(out).shots() if shot.retries}
    quiet = tree(toy / "raw")
    for name, data in tree(out / "raw").items():
        if f"raw/{name}" not in again:
            assert data == quiet[name], name
