"""Tasks at once: what begins beside what, what each is given, and what a killed process costs."""

import os
import signal
import threading
from pathlib import Path

import pytest

from imaging.compute import workers as module
from imaging.compute.workers import LocalWorkers, Share, Task, WorkerLost, apart
from imaging.errors import InputError

LONG, SHORT = 10.0, 0.1
"""Seconds: what is to happen is waited for; what is not is given so long to happen."""


class Gate:
    """A task that says when it has begun, and ends when it is let go."""

    def __init__(self, log: list[str], name: str) -> None:
        self.log, self.name = log, name
        self.begun, self.end = threading.Event(), threading.Event()
        self.share: Share | None = None

    def __call__(self, share: Share) -> str:
        self.share = share
        self.log.append(f"{self.name} begins")
        self.begun.set()
        assert self.end.wait(LONG)
        self.log.append(f"{self.name} ends")
        return self.name


@pytest.fixture
def four(monkeypatch: pytest.MonkeyPatch) -> LocalWorkers:
    """On a machine of eight cores and 100 bytes."""
    monkeypatch.setattr(module, "available_cores", lambda: 8)
    pool = LocalWorkers(4)
    pool.room = 100
    return pool


def test_a_task_begins_when_its_forecast_fits_beside_what_runs(four: LocalWorkers) -> None:
    log: list[str] = []
    a, b, c, d = (Gate(log, name) for name in "abcd")
    ends = [four.submit(Task(size), gate) for size, gate in ((60, a), (30, b), (50, c), (5, d))]
    assert a.begun.wait(LONG)
    assert b.begun.wait(LONG)
    assert not c.begun.wait(SHORT)
    assert not d.begun.is_set()  # it would fit, and is not to go before what waits
    a.end.set()
    assert c.begun.wait(LONG)
    assert d.begun.wait(LONG)
    for gate in (b, c, d):
        gate.end.set()
    assert [one.result(LONG) for one in ends] == ["a", "b", "c", "d"]
    assert log.index("a ends") < log.index("c begins")
    four.close()


def test_what_leaves_less_than_a_share_runs_alone_on_all_cores(four: LocalWorkers) -> None:
    log: list[str] = []
    large, small = Gate(log, "large"), Gate(log, "small")
    four.submit(Task(80), large)
    last = four.submit(Task(1), small)
    assert large.begun.wait(LONG)
    assert not small.begun.wait(SHORT)
    large.end.set()
    small.end.set()
    last.result(LONG)
    assert large.share == Share(room=100)
    assert small.share is not None
    assert small.share.cores == 2
    four.close()


def test_a_task_larger_than_the_machine_runs_alone(four: LocalWorkers) -> None:
    """Leave the report of a lack to the task: a forecast may be wrong."""
    assert four.submit(Task(1000), lambda share: share.pinned).result(LONG) is None
    four.close()


def test_a_gpu_belongs_to_one_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "available_cores", lambda: 8)
    pool = LocalWorkers(4, gpus=("5",))
    log: list[str] = []
    first, other, second = (Gate(log, name) for name in ("first", "other", "second"))
    pool.submit(Task(0, gpu=True), first)
    pool.submit(Task(0), other)
    assert other.begun.wait(LONG)
    last = pool.submit(Task(0, gpu=True), second)
    assert first.begun.wait(LONG)
    assert not second.begun.wait(SHORT)
    for gate in (first, other, second):
        gate.end.set()
    last.result(LONG)
    assert log.index("first ends") < log.index("second begins")
    given = [gate.share.gpu for gate in (first, other, second) if gate.share is not None]
    assert given == ["5", None, "5"]
    pool.close()


def test_what_waits_when_all_is_closed_never_begins(four: LocalWorkers) -> None:
    log: list[str] = []
    running, waiting = Gate(log, "running"), Gate(log, "waiting")
    four.submit(Task(90), running)
    waiting_task = four.submit(Task(90), waiting)
    assert running.begun.wait(LONG)
    threading.Timer(SHORT, running.end.set).start()
    four.close()
    assert waiting_task.exception(LONG) is not None
    assert log == ["running begins", "running ends"]


def test_more_workers_than_cores_are_refused() -> None:
    with pytest.raises(InputError, match="--workers 1000 is more than the"):
        LocalWorkers(1000)


def test_a_process_of_its_own_keeps_to_its_share() -> None:
    assert apart(Share(room=4321), os.getenv, "RIG_MEMORY") == "4321"


def test_a_process_that_is_the_tasks_own_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RIG_MEMORY", "1")
    assert apart(Share(room=4321, serves=True), os.getpid) == os.getpid()
    assert os.environ["RIG_MEMORY"] == "4321"


def killed(lives: Path) -> str:
    """Kills its process as often as the file has characters."""
    if remaining := lives.read_text():
        lives.write_text(remaining[1:])
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX")
def test_a_killed_process_is_begun_again_once(tmp_path: Path) -> None:
    lives = tmp_path / "lives"
    lives.write_text("x")
    assert apart(Share(), killed, lives) == "done"
    lives.write_text("xx")
    with pytest.raises(WorkerLost, match="killed 2 times"):
        apart(Share(), killed, lives)
