"""Five seeds of bench/kill.py, which runs fifty; and proof that its judgement can fail."""

import importlib.util
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "bench" / "kill.py"


@pytest.fixture(scope="module")
def kill():
    spec = importlib.util.spec_from_file_location("bench_kill", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["bench_kill"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["bench_kill"]


@pytest.fixture(scope="module")
def reference(kill, tmp_path_factory):
    return kill.make_reference(tmp_path_factory.mktemp("reference"))


@pytest.mark.parametrize("seed", range(5))
def test_a_killed_capture_keeps_every_finished_shot_and_is_completed(kill, reference, tmp_path, seed):
    trial = kill.run_trial(seed, tmp_path, reference)
    assert trial.failures == []
    assert len(trial.moments) == 1 + seed % 2
    assert not list(tmp_path.rglob(".*.part"))


@pytest.fixture
def session(kill, reference, tmp_path):
    for name, data in reference.files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(data)
    # The records of a capture with the same seed, beside the files of the reference.
    other = tmp_path / "other"
    kill.capture_simulated(kill.RIG, other, seed=kill.RIG_SEED)
    for name in ("session.json", "plans.jsonl", "shots.jsonl"):
        (other / name).rename(tmp_path / name)
    return tmp_path


def judged(kill, session, told):
    trial = kill.Trial(0)
    kill.examine(session, told, trial)
    return trial.failures


def test_the_judgement_notices_a_file_that_is_not_whole(kill, session):
    told = ["raw/0000/cam0_0.dng", "raw/0001/cam1_2.dng"]
    assert judged(kill, session, told) == []
    path = session / "raw/0001/cam1_2.dng"
    path.write_bytes(path.read_bytes()[:-1])
    assert judged(kill, session, told) == ["raw/0001/cam1_2.dng is recorded and not whole"]


def test_the_judgement_notices_a_finished_shot_without_record(kill, session):
    index = session / "shots.jsonl"
    index.write_bytes(b"".join(index.read_bytes().splitlines(keepends=True)[:-1]))
    assert judged(kill, session, ["raw/0002/cam1_2.dng"]) == ["finished and lost: raw/0002/cam1_2.dng"]
    index.with_name("session.json").unlink()
    assert judged(kill, session, ["raw/0002/cam1_2.dng"]) == ["1 shots were told and there is no session"]


def test_a_script_states_machine_versions_and_seeds(kill, tmp_path):
    described = kill.machine(tmp_path)
    assert {"cpu", "system", "python", "numpy", "rawpy"} <= set(described)
