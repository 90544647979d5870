"""The job arrays of docs/batch.md, run by a shell whose `rig` and `sbatch` write down what they are given."""

import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from rig.batch.batch_plan import BatchPlan
from rig.batch.shards import shard_of

PAGE = (Path(__file__).parents[2] / "docs" / "batch.md").read_text()
SECTION = PAGE.split("## Job arrays")[1].split("\n## ")[0]
SLURM, PLAIN = re.findall(r"```sh\n(.*?)```", SECTION, re.DOTALL)
CLOUD = {name: part for part, name in re.findall(r"`(\$\(\(.*?)` on\s+(\w+)", SECTION)}
MERGE = ["batch", "PLAN.toml", "--merge"]


@pytest.fixture
def shell(tmp_path: Path):
    """Run a script; what each of its commands was given, in the order in which they began."""
    log = tmp_path / "log"
    for name in ("rig", "sbatch"):
        # One write of a whole line, whatever runs beside it.
        (tmp_path / name).write_text(
            f'#!/bin/bash\nprintf -v line "%q " {name} "$@"; echo "$line" >> {log}\n'
        )
        (tmp_path / name).chmod(0o755)

    def run(script: str, **environment: str) -> list[list[str]]:
        log.unlink(missing_ok=True)
        path = f"{tmp_path}:{os.environ['PATH']}"
        subprocess.run(
            ["bash", "-euc", script], check=True, env={"PATH": path, **environment}, cwd=tmp_path, timeout=60
        )
        return [shlex.split(line) for line in log.read_text().splitlines()]

    return run


def shards(commands: list[list[str]]) -> list[str]:
    """Parts that were asked for, each of the form that rig takes."""
    parts = []
    for command in commands:
        assert command[:-1] == ["rig", "batch", "PLAN.toml", "--shard"]
        parts.append(command[-1])
    every = tuple(Path(f"s{number}") for number in range(len(parts)))
    plan = BatchPlan(Path("PLAN.toml"), every, ())
    sessions = [session for part in parts for session in shard_of(plan, part).sessions]
    assert sorted(sessions) == sorted(one.absolute() for one in every)
    return parts


def test_a_plain_shell_runs_all_parts_and_then_joins_them(shell) -> None:
    *parts, last = shell(PLAIN)
    assert sorted(shards(parts)) == ["1/2", "2/2"]
    assert last == ["rig", *MERGE]


def test_slurm_starts_as_many_tasks_as_there_are_parts(shell) -> None:
    submitted, last = shell(SLURM)
    assert last == ["rig", *MERGE]
    wrapped = submitted[submitted.index("--wrap") + 1]
    first, count = re.fullmatch(r"--array=(\d+)-(\d+)", submitted[1]).groups()
    tasks = range(int(first), int(count) + 1)
    commands = [one for task in tasks for one in shell(wrapped, SLURM_ARRAY_TASK_ID=str(task))]
    assert len(shards(commands)) == int(count)


@pytest.mark.parametrize(
    ("name", "index", "count"),
    [
        ("AWS", "AWS_BATCH_JOB_ARRAY_INDEX", "AWS_BATCH_JOB_ARRAY_SIZE"),
        ("Google", "BATCH_TASK_INDEX", "BATCH_TASK_COUNT"),
    ],
)
def test_schedulers_that_count_from_zero_reach_every_part(shell, name: str, index: str, count: str) -> None:
    script = f"rig batch PLAN.toml --shard {CLOUD[name]}"
    commands = [one for task in range(5) for one in shell(script, **{index: str(task), count: "5"})]
    assert shards(commands) == [f"{number}/5" for number in range(1, 6)]
