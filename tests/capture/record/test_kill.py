"""A few seeds of bench.capture.interrupted.kill, which runs 200; and proof that its judgement can fail."""

import json

import numpy as np
import pytest

from bench.capture.interrupted import kill, trials
from capture.simulated import capture_simulated


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return trials.make_reference(tmp_path_factory.mktemp("reference"))


@pytest.mark.parametrize(
    ("seed", "kind"),
    [
        (4, "killed"),
        (1, "full disk"),
        (5, "full disk"),
        (2, "removed camera"),
        (3, "read-only folder"),
    ],
)
def test_a_capture_in_trouble_keeps_every_finished_shot_and_is_completed(reference, tmp_path, seed, kind):
    trial = trials.run_trial(seed, tmp_path, reference)
    assert (trial.kind, trial.failures) == (kind, [])
    assert len(trial.moments) == (2 if seed == 4 else 1)
    assert not list(tmp_path.rglob(".*.part"))


@pytest.fixture(scope="module")
def captured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("captured") / "S"
    capture_simulated(trials.RIG, folder, seed=trials.RIG_SEED)
    return folder


@pytest.fixture
def session(captured, tmp_path):
    """A session whose files may be damaged."""
    for path in captured.rglob("*"):
        if path.is_file():
            copy = tmp_path / path.relative_to(captured)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())
    return tmp_path


def judged(reference, session, reported):
    trial = trials.Trial(0)
    trials.examine(session, reported, trial, reference)
    return trial.failures


def test_the_judgement_notices_a_file_that_is_not_whole(reference, session):
    reported = ["raw/0000/cam0_0.dng", "raw/0001/cam1_2.dng"]
    assert judged(reference, session, reported) == []
    path = session / "raw/0001/cam1_2.dng"
    path.write_bytes(path.read_bytes()[:-1])
    assert judged(reference, session, reported) == ["raw/0001/cam1_2.dng is recorded and not whole"]


def test_the_judgement_notices_another_picture_under_a_right_hash(reference, session):
    index = session / "shots.jsonl"
    one, other = (session / f"raw/0000/cam0_{step}.dng" for step in (0, 1))
    mine, theirs = (trials.store.sha256(path) for path in (one, other))
    one.write_bytes(other.read_bytes())
    index.write_text(index.read_text().replace(mine, theirs))
    assert judged(reference, session, []) == ["raw/0000/cam0_0.dng is recorded and another picture"]


def test_the_judgement_notices_a_finished_shot_without_record(reference, session):
    index = session / "shots.jsonl"
    lines = index.read_bytes().splitlines(keepends=True)
    lost = json.loads(lines[-1])["file"]
    index.write_bytes(b"".join(lines[:-1]))
    assert judged(reference, session, [lost]) == [f"finished and lost: {lost}"]
    index.with_name("session.json").unlink()
    assert judged(reference, session, [lost]) == ["1 shots were reported and there is no session"]


def test_the_judgement_notices_a_check_that_accepts_a_flipped_bit(session, monkeypatch):
    trial = trials.Trial(0, recorded=trials.SHOTS)
    trials.examine_check(session, trial, np.random.default_rng(0))
    assert trial.failures == []
    untouched = trials.check(session)
    monkeypatch.setattr(trials, "check", lambda folder: untouched)
    trials.examine_check(session, trial, np.random.default_rng(0))
    assert len(trial.failures) == 1
    assert "passes the check" in trial.failures[0]


@pytest.mark.parametrize(
    ("code", "recorded", "out", "err", "words"),
    [
        (0, 18, "", "", ""),
        (2, 0, "", "The disk is full: free it.\n", ""),
        (2, 4, "", "The disk is full: free it.\n", "exit code 2 with 4 shots"),
        (1, 0, "", "This is a defect of rig.\n", "exit code 1"),
        (2, 0, "", "Traceback\nKeyError\n", "not one sentence"),
        (
            3,
            4,
            '{"taken": 4, "earlier": 0, "missing_shots": []}',
            "Some are missing.\n",
            "reported missing",
        ),
        (3, 4, '{"error": "x"}', "Some are missing.\n", "14 missing shots are not reported"),
        (3, 18, '{"error": "x"}', "All shots are there, the truth is not.\n", ""),
    ],
)
def test_the_judgement_notices_a_wrong_way_out(code, recorded, out, err, words):
    trial = trials.Trial(0, recorded=recorded)
    trials.examine_exit(code, out, err, trial)
    assert bool(trial.failures) == bool(words)
    assert words in "".join(trial.failures)


def test_a_script_states_machine_versions_and_seeds(tmp_path):
    described = kill.machine(tmp_path)
    assert {"cpu", "system", "python", "numpy", "rawpy"} <= set(described)
