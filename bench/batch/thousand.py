"""A day of many small sessions, in parts that are killed and run again: what fails, and what a session costs.

    python -m bench.batch.thousand [--quick] [--json] [--write] [--sessions 1000] [--at-once 2] [--seed 0]
        [--folder DIR]

Sessions of ten kinds (bench/batch/kinds.py, one each, copied) are carried out by `rig batch --shard i/N`,
five sessions to a part, some parts at once. A twentieth of the parts is killed, each at a random moment of
the time that an undisturbed part takes, and run again. Then `rig batch --merge`. No failure may be a defect,
no session may be missing, and copies of one session must end alike.

--write puts the table into bench/results/thousand.md. --folder keeps the sessions: with it, a day that was
interrupted goes on with the parts that are not done.
"""

import json
import os
import random
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from bench.batch.kinds import KINDS
from bench.support.record import arguments, deliver, machine, words
from imaging.files import store
from rig.batch.result import BatchRow

PLAN = """sessions = ["scans/*"]
[[scene]]
name = "small"
quality = "draft"
set = { iterations = 30, gaussians = 300, width = 96, refine = "none", environment = false }
"""
OF_A_PART = 5
KILLED = 0.05
UNKNOWN = 60.0
"""Seconds that a part may take where there is only one."""
QUICK = 10


def templates(folder: Path) -> dict[str, Path]:
    """A session of each kind."""
    made = {}
    for number, (kind, make) in enumerate(KINDS.items()):
        made[kind] = folder / str(number) / "session"
        made[kind].parent.mkdir(parents=True)
        make(made[kind])
    return made


def begin(plan: Path, part: str) -> "subprocess.Popen[bytes]":
    """Begin a part of the plan; what it says is kept beside the plan."""
    return subprocess.Popen(
        [sys.executable, "-m", "rig", "batch", str(plan), "--shard", part, "--quiet"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=plan.with_name(f"{part.replace('/', '-of-')}.err").open("wb"),
    )


def carried_out(
    plan: Path, parts: Sequence[str], killed: set[str], at_once: int, rng: random.Random
) -> tuple[float, int]:
    """Carry out the parts that are not done, some at once, and kill some.

    Returns:
        Processor seconds of the parts without their steps, and the number of them that were killed in time.
    """
    ledger = plan.with_name("killed.json" if killed else "again.json")
    done: dict[str, dict[str, float]] = json.loads(ledger.read_text()) if ledger.exists() else {}
    waiting = [part for part in parts if part not in done]
    going: dict[str, tuple[subprocess.Popen[bytes], float, float]] = {}
    while waiting or going:
        took = [one["took"] for part, one in done.items() if part not in killed]
        while waiting and len(going) < at_once:
            # A part that is killed waits for the first to say how long one takes.
            part = next(
                (one for one in waiting if one not in killed or took or killed.issuperset(parts)), None
            )
            if part is None:
                break
            waiting.remove(part)
            dies = rng.uniform(0.0, statistics.median(took or [UNKNOWN])) if part in killed else float("inf")
            going[part] = begin(plan, part), time.monotonic(), dies
        for part, (process, began, dies) in list(going.items()):
            if time.monotonic() - began > dies:
                os.kill(process.pid, signal.SIGKILL)  # Popen.kill would take its usage
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            if ended:
                process.returncode = os.waitstatus_to_exitcode(status)
                done[part] = {
                    "died": process.returncode == -signal.SIGKILL,
                    "spent": usage.ru_utime + usage.ru_stime,
                    "took": time.monotonic() - began,
                }
                store.write_json(ledger, done)
                del going[part]
        time.sleep(0.2)
    return sum(one["spent"] for one in done.values()), round(sum(one["died"] for one in done.values()))


def cause(row: BatchRow) -> str:
    """The sentence of a failure without what is of the session alone."""
    text = row.says.replace(str(row.session), "SESSION")
    return re.sub(r"for its \d+ images", "for its images", text)


def day(count: int, at_once: int, seed: int, folder: Path) -> dict[str, Any]:
    """Make the sessions, if they are not there, and carry them out."""
    rng, plan = random.Random(seed), folder / "PLAN.toml"
    order = [list(KINDS)[number % len(KINDS)] for number in range(count)]
    rng.shuffle(order)
    kinds = {(folder / "scans" / f"{number:04d}").absolute(): kind for number, kind in enumerate(order)}
    if not plan.exists():
        for part in ("kinds", "scans"):
            shutil.rmtree(folder / part, ignore_errors=True)
        made = templates(folder / "kinds")
        for copy, kind in kinds.items():
            shutil.copytree(made[kind], copy)
        plan.write_text(PLAN)
    total = -(-count // OF_A_PART)
    parts = [f"{number + 1}/{total}" for number in range(total)]
    killed = set(rng.sample(parts, max(round(KILLED * total), 1)))
    spent, died = carried_out(plan, parts, killed, at_once, rng)
    spent += carried_out(plan, sorted(killed), set(), at_once, rng)[0]
    subprocess.run(
        [sys.executable, "-m", "rig", "batch", str(plan), "--merge", "--quiet"],
        stdout=subprocess.DEVNULL,
        check=False,
    )
    record = json.loads(plan.with_suffix(".batch.json").read_text())
    rows = [BatchRow.model_validate(row) for row in record["rows"]]
    said = "".join(path.read_text(errors="replace") for path in folder.glob("*.err"))
    return {
        "rows": [(kinds[row.session], row) for row in rows],
        "sessions": count,
        "missing": count - len(rows),
        "parts": total,
        "killed": died,
        "spent": spent,
        "tracebacks": said.count("Traceback") + sum("defect" in row.says for row in rows),
    }


def table(result: dict[str, Any], on: str) -> str:
    """The committed result."""
    rows: list[tuple[str, BatchRow]] = result["rows"]
    of_kind: dict[str, list[BatchRow]] = defaultdict(list)
    for kind, row in rows:
        of_kind[kind].append(row)
    seconds = sum(row.processor_seconds or 0.0 for _, row in rows)
    made = sum(row.failed is None for _, row in rows)
    count = result["sessions"]
    lines = [
        "# A day of many small sessions",
        "",
        f"`python -m bench.batch.thousand --sessions {count} --write`: {count} sessions of ten kinds, of "
        f"views of 96x72 px, a draft of 30 iterations, in {result['parts']} parts, {result['killed']} "
        f"of them killed and run again. {made} scenes were made, {len(rows) - made} failed with a sentence, "
        f"{result['tracebacks']} with a traceback, and {result['missing']} have no result. {on}.",
        "",
        "| kind | sessions | scenes | processor s a session | most | MB a session |",
        "|---|---|---|---|---|---|",
    ]
    for kind, some in of_kind.items():
        cost = [row.processor_seconds or 0.0 for row in some]
        made_of = sum(row.failed is None for row in some)
        size = statistics.mean(row.disk or 0 for row in some) / 1e6
        lines.append(
            f"| {kind} | {len(some)} | {made_of} | {statistics.mean(cost):.1f} "
            f"| {max(cost):.1f} | {size:.1f} |"
        )
    lines += ["", "## Failures by cause", "", "| cause | step | sessions |", "|---|---|---|"]
    causes = Counter((cause(row), row.failed) for _, row in rows if row.failed)
    lines += [f"| {text} | {step} | {number} |" for (text, step), number in causes.most_common()]
    lines += [
        "",
        "## Processor seconds",
        "",
        "| part | s |",
        "|---|---|",
        f"| steps of all sessions | {seconds:.0f} |",
        f"| `rig batch` itself, all parts | {result['spent']:.0f} |",
        "",
    ]
    return "\n".join(lines)


def wrong(result: dict[str, Any]) -> list[str]:
    """Sentences on what may not be."""
    ends: dict[str, set[tuple[str | None, str]]] = defaultdict(set)
    for kind, row in result["rows"]:
        ends[kind].add((row.failed, cause(row) if row.failed else ""))
    wrongs = [
        f"{kind}: copies end differently: {sorted(map(str, some))}"
        for kind, some in ends.items()
        if len(some) > 1
    ]
    wrongs += [f"{result['missing']} sessions have no result"] if result["missing"] else []
    return wrongs + ([f"{result['tracebacks']} tracebacks"] if result["tracebacks"] else [])


def main() -> int:
    """Run the day; 1 if anything went wrong that may not."""
    parser = arguments(__doc__)
    parser.add_argument("--sessions", type=int, default=1000)
    parser.add_argument("--at-once", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    count = QUICK if options.quick else options.sessions
    with nullcontext(options.folder) if options.folder else tempfile.TemporaryDirectory() as place:
        result = day(count, options.at_once, options.seed, Path(place))
    text, problems = table(result, words(machine())), wrong(result)
    result["rows"] = [(kind, row.model_dump(mode="json")) for kind, row in result["rows"]]
    deliver(options, "thousand", result, text)
    print(*problems, sep="\n", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    raise SystemExit(main())
