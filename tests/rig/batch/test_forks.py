"""Commands as forks: the same words and end as a Python of their own; a killed one leaves nothing behind."""

import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import pytest

from imaging.compute.workers import LocalWorkers, Share, Task
from rig.batch.command_processes import Ended, run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="forks of a server, on Linux alone")


@pytest.fixture(autouse=True)
def _this_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process that forks imports this very code."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[3]), *sys.path]))


def below(process: int) -> Iterator[int]:
    """Processes that a process began, and those that they did."""
    for task in Path(f"/proc/{process}/task").glob("*"):
        try:
            children = [int(child) for child in (task / "children").read_text().split()]
        except OSError:  # it has ended
            continue
        for child in children:
            yield child
            yield from below(child)


def waiting(pipe: Path, first: int) -> tuple[IO[str], int]:
    """Open the other end of a pipe from which a command reads a plan; also the process of the command."""
    end = pipe.open("w")
    (command,) = {one for one in below(first) if str(pipe) in map(_link, Path(f"/proc/{one}/fd").glob("*"))}
    return end, command


def _link(entry: Path) -> str:
    try:
        return os.readlink(entry)
    except OSError:  # it is closed
        return ""


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "PLAN.toml")
    return tmp_path / "PLAN.toml"


def test_a_command_ends_as_in_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither reads the configuration file of the user, which this one would be refused for."""
    (tmp_path / "config.toml").write_text("[cameras]\nnone = 1\n")
    monkeypatch.setenv("RIG_CONFIG", str(tmp_path / "config.toml"))
    words = ["cameras", "--sim", "toy"]
    fork, alone = run(Share(cores=1, room=10**9), words), run(Share(serves=True), words)
    assert (fork.code, fork.data) == (alone.code, alone.data) == (0, alone.data)
    assert fork.data["cameras"]
    assert fork.cost.peak is not None
    refused = run(Share(), ["check", str(tmp_path / "none")])
    assert refused.code == 2
    assert str(tmp_path / "none") in refused.says


def test_what_the_stages_take_to_import_is_spent_once(toy: Path) -> None:
    first, second = (run(Share(), ["calibrate", str(toy / "none")]) for _ in range(2))
    alone = run(Share(serves=True), ["calibrate", str(toy), "--only", "response"])
    fork = run(Share(), ["calibrate", str(toy), "--only", "response"])
    assert first.code == second.code == 2
    assert fork.code == alone.code
    assert fork.cost.processor_seconds is not None
    assert alone.cost.processor_seconds is not None
    assert fork.cost.processor_seconds < 0.6 * alone.cost.processor_seconds


def test_a_killed_command_is_run_again_once(pipe: Path) -> None:
    outcomes: list[Ended] = []
    thread = threading.Thread(target=lambda: outcomes.append(run(Share(), ["batch", str(pipe)])))
    thread.start()
    for _ in range(2):
        end, command = waiting(pipe, os.getpid())
        with end:
            descriptor = os.pidfd_open(command)
            os.kill(command, signal.SIGKILL)
            assert select.select([descriptor], [], [], 30)[0]
    thread.join()
    (outcome,) = outcomes
    assert (outcome.code, outcome.attempts) == (-signal.SIGKILL, 2)
    assert outcome.says == "its process was killed 2 times (SIGKILL)."
    assert outcome.cost.processor_seconds is not None
    assert outcome.cost.processor_seconds > 0


def test_a_killed_batch_leaves_no_command_behind(pipe: Path) -> None:
    code = (
        "from imaging.compute.workers import Share; from rig.batch import command_processes, forks; "
        f"forks.STAGES.clear(); command_processes.run(Share(), ['batch', {str(pipe)!r}])"
    )
    batch = subprocess.Popen([sys.executable, "-c", code])
    end, command = waiting(pipe, batch.pid)
    with end:
        descriptor = os.pidfd_open(command)
        batch.kill()
        batch.wait()
        assert select.select([descriptor], [], [], 30)[0]


def test_commands_run_beside_each_other(tmp_path: Path) -> None:
    workers = LocalWorkers(1)
    try:
        ended = [workers.submit(Task(0), run, ["check", str(tmp_path / name)]) for name in ("a", "b")]
        for name, one in zip("ab", ended, strict=True):
            assert str(tmp_path / name) in one.result().says
    finally:
        workers.close()
