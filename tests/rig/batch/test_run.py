"""A plan carried out: what is begun after what, what fails, and what a killed process costs."""

import os
import signal
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path

import pytest

from imaging.compute.workers import Share, Task
from imaging.errors import InputError
from imaging.files import store
from rig.batch import command_processes, forecasts
from rig.batch.batch_plan import BatchPlan, PlannedScene
from rig.batch.command_processes import Cost, Ended, begun, run
from rig.batch.run import carry_out

COSTS = {"calibrate": Cost(8.0, 30), "reconstruct": Cost(4.0, 70), "export": Cost(2.0, 10)}


class Recorder:
    """Ends every command at once, as `fails` has it, and keeps what it was given.

    code: 3 where what fails is done in part.
    """

    def __init__(self, code: int = 2, **fails: str) -> None:
        self.code, self.fails = code, fails
        self.commands, self.tasks = list[list[str]](), list[Task]()

    def submit(self, task: Task, function: Callable[..., Ended], words: Sequence[str]) -> "Future[Ended]":
        assert function is run
        self.commands.append(list(words))
        self.tasks.append(task)
        code, says = (self.code, self.fails[words[0]]) if words[0] in self.fails else (0, "")
        made = (
            Path(words[1])
            / "reconstructions"
            / (words[words.index("--seed") + 1] if "--seed" in words else "")
        )
        data = {
            "reconstruction": str(made),
            "held_out_db": 30.0,
            "iterations": 20,
            "report": str(made / "r.html"),
        }
        future: Future[Ended] = Future()
        there = words[0] == "reconstruct" and code != 2
        future.set_result(Ended(code, data if there else {}, says, 1.0, 1, COSTS[words[0]]))
        return future


@pytest.fixture(autouse=True)
def forecast(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forecast of sessions that are empty folders."""
    monkeypatch.setattr(forecasts, "calibration", lambda session: Task(100))
    monkeypatch.setattr(forecasts, "training", lambda session, scene, workers: Task(scene.seed, gpu=True))
    monkeypatch.setattr(forecasts, "export", lambda reconstruction: Task(50))


def planned(folder: Path) -> BatchPlan:
    """Two sessions, the first calibrated; two scenes of each, the first exported twice."""
    for name in ("a", "b"):
        (folder / name).mkdir()
    store.make_folder(folder / "a" / "calibration")
    (folder / "a" / "calibration" / "calibration.json").touch()
    scenes = (PlannedScene(seed=1, name="one", export=("x.ply", "y.usdc")), PlannedScene(seed=2))
    return BatchPlan(folder / "PLAN.toml", (folder / "a", folder / "b"), scenes)


def test_what_is_calibrated_is_trained_and_exports_follow(tmp_path: Path) -> None:
    recorder = Recorder()
    result = carry_out(planned(tmp_path), recorder)
    steps = [(words[0], Path(words[1]).relative_to(tmp_path).parts[0]) for words in recorder.commands]
    assert steps.count(("calibrate", "b")) == 1
    assert ("calibrate", "a") not in steps
    assert steps.index(("calibrate", "b")) < steps.index(("reconstruct", "b"))
    assert steps.count(("reconstruct", "a")) == steps.count(("reconstruct", "b")) == 2
    assert steps.count(("export", "a")) == steps.count(("export", "b")) == 2
    assert [(row.session.name, row.scene) for row in result.rows] == [
        ("a", "one"), ("a", "auto standard"), ("b", "one"), ("b", "auto standard"),
    ]  # fmt: skip
    assert [row.seconds for row in result.rows] == [3.0, 1.0, 4.0, 1.0]  # b's first with its calibration
    assert [row.processor_seconds for row in result.rows] == [8.0, 4.0, 16.0, 4.0]  # likewise
    assert {row.peak for row in result.rows} == {70}
    assert [path.name for path in result.rows[0].exports] == ["x.ply", "y.usdc"]
    assert all(row.failed is None and row.db == 30.0 for row in result.rows)
    assert [row.forecast for row in result.rows] == [1, 2, 1, 2]
    tasks = dict(zip((words[0] for words in recorder.commands), recorder.tasks, strict=True))
    assert (tasks["calibrate"], tasks["export"], tasks["reconstruct"].gpu) == (Task(100), Task(50), True)
    assert len(store.read_json(tmp_path / "PLAN.batch.json")["rows"]) == 4


def test_what_fails_is_told_and_the_rest_goes_on(tmp_path: Path) -> None:
    said: list[str] = []
    result = carry_out(planned(tmp_path), Recorder(calibrate="No view."), on_message=said.append)
    assert [row.failed for row in result.rows] == [None, None, "calibrate", "calibrate"]
    assert {row.says for row in result.rows[2:]} == {"No view."}
    assert [row.words for row in result.rows[2:]] == [row.words for row in result.rows[:2]]
    assert [row.processor_seconds for row in result.rows[2:]] == [8.0, None]  # once for the session
    assert any(line.endswith("b, one: calibrate failed: No view.") for line in said)


def test_what_is_made_in_part_says_what_it_lacks(tmp_path: Path) -> None:
    said: list[str] = []
    recorder = Recorder(code=3, calibrate="A view has no pose.", reconstruct="20 dB, not 35.")
    rows = carry_out(planned(tmp_path), recorder, on_message=said.append).rows
    assert [row.says for row in rows] == [
        "20 dB, not 35.",
        "20 dB, not 35.",
        "A view has no pose. 20 dB, not 35.",  # the session is calibrated for its first scene
        "20 dB, not 35.",
    ]
    assert {row.failed for row in rows} == {None}
    assert sum("made in part: A view has no pose." in line for line in said) == 1


def test_a_calibration_counts_though_the_training_fails(tmp_path: Path) -> None:
    rows = carry_out(planned(tmp_path), Recorder(reconstruct="No pose.")).rows
    assert [row.processor_seconds for row in rows] == [4.0, 4.0, 12.0, 4.0]
    assert [row.seconds for row in rows] == [1.0, 1.0, 2.0, 1.0]


def test_bytes_are_those_of_the_session(tmp_path: Path) -> None:
    plan = planned(tmp_path)
    (tmp_path / "a" / "raw").mkdir()
    (tmp_path / "a" / "raw" / "1.dng").write_bytes(bytes(1234))
    assert [row.disk for row in carry_out(plan, Recorder()).rows] == [1234, 1234, 0, 0]


def test_an_export_that_fails_leaves_the_scene(tmp_path: Path) -> None:
    first, *_ = carry_out(planned(tmp_path), Recorder(export="No disk.")).rows
    assert (first.failed, first.says, first.db, first.exports) == ("export", "No disk.", 30.0, ())


def test_what_fits_no_machine_is_told_and_never_begun(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(session: Path, scene: PlannedScene, workers: object) -> Task:
        if scene.name is None:
            raise InputError("Training takes 9 GB more: give --set width=640.")
        return Task(1)

    monkeypatch.setattr(forecasts, "training", refused)
    recorder = Recorder()
    first, second, *_ = carry_out(planned(tmp_path), recorder).rows
    assert (first.failed, second.failed, second.forecast) == (None, "reconstruct", None)
    assert second.says == "Training takes 9 GB more: give --set width=640."
    assert not any("--seed" in words and "2" in words for words in recorder.commands)


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stands for Python: is killed as often as the file `lives` has lines, then prints its words as JSON."""
    lives, path = tmp_path / "lives", tmp_path / "program"
    path.write_text(
        f"""#!/bin/sh
if [ -s {lives} ]; then sed -i 1d {lives}; kill -9 $$; fi
echo about >&2
echo '{{"words": "'"$*"'", "room": "'"$RIG_MEMORY"'", "gpu": "'"$CUDA_VISIBLE_DEVICES"'"}}'
"""
    )
    path.chmod(0o755)
    monkeypatch.setattr(command_processes.sys, "executable", str(path))
    return lives


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(("kills", "code", "attempts"), [(0, 0, 1), (1, 0, 2), (2, -signal.SIGKILL, 2)])
def test_a_command_whose_process_is_killed_is_run_again_once(
    program: Path, kills: int, code: int, attempts: int
) -> None:
    program.write_text("x\n" * kills)
    ended = run(Share(room=1234, gpu="3", serves=True), ["reconstruct", "S"])
    assert (ended.code, ended.attempts) == (code, attempts)
    if code:
        assert ended.says == "its process was killed 2 times (SIGKILL)."
    else:
        assert ended.data == {"words": "-m rig reconstruct S --json", "room": "1234", "gpu": "3"}
        assert ended.says == "about"


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="wait4 of POSIX")
def test_the_cost_of_every_attempt_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two attempts of half a second of arithmetic each with 200 MB, the first of them killed after it."""
    path, killed = tmp_path / "program", tmp_path / "killed"
    path.write_text(
        f"""#!{sys.executable}
import os, time
block = bytes([1]) * 200_000_000
while time.process_time() < 0.5:
    pass
if not os.path.exists({str(killed)!r}):
    open({str(killed)!r}, "w").close()
    os.kill(os.getpid(), 9)
print("{{}}")
"""
    )
    path.chmod(0o755)
    monkeypatch.setattr(command_processes.sys, "executable", str(path))
    ended = run(Share(serves=True), ["check", "S"])
    assert (ended.code, ended.attempts) == (0, 2)
    assert ended.cost.processor_seconds == pytest.approx(1.2, abs=0.25)
    assert ended.cost.peak is not None
    assert ended.cost.peak > 200_000_000


def test_more_workers_than_cores_are_refused() -> None:
    with pytest.raises(InputError, match="more than the"), begun(1000, None, 4):
        pass
