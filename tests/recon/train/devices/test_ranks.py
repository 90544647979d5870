"""Two processes over Gloo train what one trains that looks at two views a step."""

import json
import multiprocessing
import os
import socket
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imaging.compute.threads import thread_count
from imaging.errors import ReconstructionError
from recon.data.dataset import Dataset
from recon.data.load import load
from recon.decide.cost.countdown import TooShort
from recon.observe.refinement import Refinement
from recon.result.model import read_model
from recon.scene.checkpoint import read_checkpoint, write_checkpoint
from recon.train.densification import DensityRules
from recon.train.devices.ranks import Ranks, joined
from recon.train.monitor import Hooks
from recon.train.trainer import train
from recon.train.training import Plan, Training
from recon.train.training_checkpoint import checkpoint_of
from tests.recon.beginning import beginning

PLAN = Plan(12, DensityRules(700, every=0.1), seed=5, batch=2, log_every=4)


def begin(dataset: Dataset) -> Training:
    refinement = Refinement.of(dataset, ["poses", "exposures", "vignetting"])
    return beginning(dataset, 500)(refinement=refinement)


def train_here(session: Path, out: Path, ranks: Ranks) -> list[dict[str, float]]:
    """Train the plan, stopping once on the way as at a checkpoint; leaves OUT/RANK.safetensors."""
    dataset, lines = load(session), []
    training = begin(dataset)
    for until in (5, PLAN.iterations):
        train(training, dataset, PLAN, Hooks(log=lines.append), until=until, ranks=ranks)
    training.gather(ranks)
    write_checkpoint(out / f"{ranks.number}.safetensors", checkpoint_of(training, {}))
    return lines


def free_port() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])


def together(folder: Path, call: Callable[..., int], *arguments: object) -> list[tuple[int | None, str, str]]:
    """Call a function in two processes, as torchrun starts them; exit code, output and error of each."""
    common = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": free_port(), "GLOO_SOCKET_IFNAME": "lo"}
    common |= {"WORLD_SIZE": "2", "LOCAL_WORLD_SIZE": "2"}
    context = multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")
    context.set_forkserver_preload([__name__, "rig.commands.reconstruct"])  # imported once for all ranks
    places = [[folder / f"{rank}.{name}" for name in ("out", "err")] for rank in range(2)]
    started = [
        context.Process(
            target=as_rank,
            args=(common | {"RANK": str(rank), "LOCAL_RANK": str(rank)}, streams, call, *arguments),
        )
        for rank, streams in enumerate(places)
    ]
    for process in started:
        process.start()
    for process in started:
        process.join()
    return [
        (process.exitcode, out.read_text(), err.read_text())
        for process, (out, err) in zip(started, places, strict=True)
    ]


def as_rank(
    environment: Mapping[str, str], streams: Sequence[Path], call: Callable[..., int], *arguments: object
) -> None:
    """Call a function with these variables, its output and error in files, and exit with what it returns."""
    os.environ.update(environment)
    for number, path in enumerate(streams, 1):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), number)
    sys.exit(call(*arguments))


def command(*words: str) -> int:
    """Run `rig`, as `python -m rig` does."""
    code: int = import_module("rig.__main__").main(words)
    return code


def decide_and_train(session: Path, out: Path) -> int:
    """Print as JSON what a rank decided, and the log of what it trained."""
    with joined() as here:
        decided = decide_here(here)
        lines = train_here(session, out, here)
    print(json.dumps({"decided": decided, "lines": lines}))
    return 0


@pytest.fixture(scope="module")
def two(toy: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, Any]]]:
    """What two processes decided and trained: their folder, and what each of them printed."""
    folder = tmp_path_factory.mktemp("ranks")
    results = together(folder, decide_and_train, toy, folder)
    assert [code for code, _, _ in results] == [0, 0], results[0][2] + results[1][2]
    return folder, [json.loads(out) for _, out, _ in results]


def test_two_ranks_give_what_one_gives(
    toy: Path, two: tuple[Path, list[dict[str, Any]]], tmp_path: Path
) -> None:
    """To the last bit: a sum of two gradients does not depend on who adds."""
    folder, printed = two
    lines = train_here(toy, tmp_path, Ranks())
    first, second = (read_checkpoint(folder / f"{rank}.safetensors").tensors for rank in range(2))
    expected = read_checkpoint(tmp_path / "0.safetensors").tensors
    assert set(first) == set(second) == set(expected)
    for name, value in expected.items():
        assert torch.equal(first[name], second[name]), name
        if name == "stats.tension":  # sums over iterations, in another order
            torch.testing.assert_close(first[name], value, rtol=1e-12, atol=0)
        else:
            assert torch.equal(first[name], value), name
    logged = [one["lines"] for one in printed]
    assert logged[1] == []
    assert [line["iteration"] for line in logged[0]] == [line["iteration"] for line in lines] == [4, 8, 12]
    for ours, theirs in zip(logged[0], lines, strict=True):
        assert ours["loss"] == pytest.approx(theirs["loss"], rel=1e-9)
    assert len(expected["gaussians.means"]) == 700


def test_the_command_trains_on_two_ranks_and_only_one_speaks(session_copy: Path, tmp_path: Path) -> None:
    words = ["reconstruct", str(session_copy), "--quality", "draft", "--budget", "90s"]
    first, second = together(tmp_path, command, *words, "--set", "iterations=20", "--json")
    assert first[0] == second[0] == 0, first[2] + second[2]
    assert json.loads(first[1])["command"] == "reconstruct"
    assert second[1] == second[2] == ""
    record = read_model(session_copy / "reconstructions" / "nh-3dgs-draft-90s")
    assert record.settings.batch == 2
    assert "1 thread" in record.device or "threads" in record.device


def test_a_batch_that_cannot_be_shared_is_refused(toy_dataset: Dataset) -> None:
    plan = Plan(2, DensityRules(700), batch=3)
    with pytest.raises(ValueError, match="batch of 3 views cannot be shared by 2 ranks"):
        train(begin(toy_dataset), toy_dataset, plan, ranks=Ranks(0, 2))


def decide_here(ranks: Ranks) -> list[object]:
    """Decide twice: the first rank alone has values, then an error."""

    def values() -> dict[str, object]:
        assert ranks.first, "decided twice"
        return {"points": np.arange(3.0), "far": torch.full((2,), 0.1), "count": 1234}

    def refuse() -> None:
        assert ranks.first, "decided twice"
        raise TooShort("5 s are too short.")

    plan = ranks.decided(values)
    try:
        ranks.decided(refuse)
    except TooShort as error:
        return [plan["points"].tolist(), plan["far"].tolist(), plan["count"], str(error)]
    return []


def test_the_first_rank_decides_for_all_and_its_error_is_that_of_all(
    two: tuple[Path, list[dict[str, Any]]],
) -> None:
    first, second = (one["decided"] for one in two[1])
    assert first == second
    assert first == [[0.0, 1.0, 2.0], torch.full((2,), 0.1).tolist(), 1234, "5 s are too short."]


def test_a_time_that_is_too_short_ends_both_ranks_with_one_sentence(
    session_copy: Path, tmp_path: Path
) -> None:
    first, second = together(tmp_path, command, "reconstruct", str(session_copy), "--budget", "1s")
    assert (first[0], second[0]) == (2, 2), first[2] + second[2]
    assert "1 s are too short for this scene" in second[2]
    assert first[2].endswith(second[2])


def test_more_processes_than_gpus_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """On each of them, so that none waits for another."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    before = thread_count()
    for rank in range(2):
        for name, value in (("WORLD_SIZE", 2), ("LOCAL_WORLD_SIZE", 2), ("LOCAL_RANK", rank)):
            monkeypatch.setenv(name, str(value))
        with (
            pytest.raises(ReconstructionError, match="has 1: start torchrun with --nproc-per-node 1 here"),
            joined(),
        ):
            raise AssertionError
    assert thread_count() == before
