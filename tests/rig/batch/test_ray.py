"""Tasks on a Ray cluster: the same words and end; what it has room for, what a lost process costs."""

import importlib
import os
import sys
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from imaging.compute.workers import Share, Task, WorkerLost
from imaging.errors import InputError
from imaging.files import store
from recon.decide.overrides import Overrides
from recon.trade import Choice, trade_sweep
from rig.batch import command_processes
from rig.batch.command_processes import RayWorkers, run
from tests.rig.batch.ray_tasks import given, killed, refused

pytest.importorskip("ray")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RayWorkers]:
    with pytest.MonkeyPatch.context() as patch:
        # A token of this host would be asked for by a cluster that begins here after Ray was imported.
        patch.setenv("RAY_AUTH_TOKEN_PATH", str(tmp_path_factory.mktemp("ray") / "none"))
        patch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parents[3]), *filter(None, sys.path)]))
        pool = RayWorkers("local", cores=1)
        try:
            yield pool
        finally:
            pool.close()


SMALL = Task(100_000_000)


def test_commands_end_as_they_do_here(cluster: RayWorkers, tmp_path: Path) -> None:
    good = cluster.submit(SMALL, run, ["cameras", "--sim", "toy"])
    bad = cluster.submit(SMALL, run, ["check", str(tmp_path / "none")])
    assert [camera["identity"]["serial"] for camera in good.result().data["cameras"]] == [
        "SIM-RAW-001",
        "SIM-RAW-002",
    ]
    assert (good.result().code, bad.result().code) == (0, 2)
    assert str(tmp_path / "none") in bad.result().says


def test_the_scheduler_is_given_the_forecast(cluster: RayWorkers) -> None:
    share, resources = cluster.submit(Task(300_000_000), given).result()
    assert (resources["CPU"], resources["memory"]) == (1, 300_000_000)
    assert share == Share(cores=1, room=cluster.room, serves=True)


def test_a_lost_worker_is_made_up_for(cluster: RayWorkers, tmp_path: Path) -> None:
    lives = tmp_path / "lives"
    lives.write_text("x")
    assert cluster.submit(SMALL, killed, lives).result() == "done"


def test_one_that_is_lost_again_is_an_error_of_rig(cluster: RayWorkers) -> None:
    import ray

    lost, passed_on = Future[str](), Future[str]()
    lost.set_exception(ray.exceptions.WorkerCrashedError())
    cluster._pass_on(lost, passed_on)
    with pytest.raises(WorkerLost, match="lost 2 times"):
        passed_on.result()


def test_an_error_is_that_of_the_function(cluster: RayWorkers) -> None:
    with pytest.raises(InputError, match=r"^This is no session: name one\.$"):
        cluster.submit(SMALL, refused).result()


def test_what_fits_no_node_is_refused(cluster: RayWorkers) -> None:
    with pytest.raises(InputError, match=r"It takes about 999000\.0 GB .* no node .*: add one"):
        cluster.submit(Task(999 * 10**12), run, ["check"]).result()


def test_a_trade_off_is_what_it_is_on_one_machine(
    cluster: RayWorkers, toy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    choice = Choice(axis="preset", overrides=Overrides(iterations=10, gaussians=100, width=32))
    sweep = importlib.import_module("recon.trade.sweep")
    monkeypatch.setattr(sweep, "planned", lambda session, standard: [choice])
    monkeypatch.setattr(sweep, "neighbours", lambda points, session: [])
    spread = trade_sweep(toy, budget=1e6, workers=cluster)
    store.discard(toy / "trade" / "trade.json")
    alone = trade_sweep(toy, budget=1e6)
    rest = {"seconds", "processor_seconds", "at_once", "device"}
    made, expected = (
        {point.key: point.model_dump(exclude=rest) for point in trade.points} for trade in (spread, alone)
    )
    assert made == expected
    assert {(point.at_once, point.device) for point in spread.points} == {(cluster.beside, "CPU, 1 thread")}


def of_nodes(monkeypatch: pytest.MonkeyPatch, *nodes: dict[str, float]) -> None:
    """A cluster that says it has these, and can do nothing."""
    listed = [{"Alive": True, "Resources": node} for node in nodes]
    listed.append({"Alive": False, "Resources": {"CPU": 64, "memory": 64e9}})

    @contextmanager
    def joined(address: str) -> Iterator[Any]:
        yield SimpleNamespace(nodes=lambda: listed, remote=lambda function: None)

    monkeypatch.setattr(command_processes, "joined", joined)


def test_room_is_that_of_the_nodes_that_can_train(monkeypatch: pytest.MonkeyPatch) -> None:
    of_nodes(monkeypatch, {"CPU": 8, "memory": 9e9}, {"CPU": 4, "memory": 8e9}, {"CPU": 2, "memory": 99e9})
    pool = RayWorkers("somewhere", cores=4)
    assert (pool.room, pool.at_once, pool.beside) == (9e9, 3, 2)
    of_nodes(
        monkeypatch, {"CPU": 64, "memory": 99e9}, {"CPU": 16, "memory": 9e9, "GPU": 2}, {"CPU": 2, "GPU": 1}
    )
    pool = RayWorkers("somewhere", cores=4)
    assert (pool.room, pool.at_once, pool.beside) == (9e9, 2, 2)


def test_more_cores_than_any_node_has_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    of_nodes(monkeypatch, {"CPU": 8, "memory": 9e9}, {"CPU": 4, "memory": 8e9})
    with pytest.raises(InputError, match=r"somewhere .* has 16 cores: give --cores 8 or fewer\."):
        RayWorkers("somewhere", cores=16)
