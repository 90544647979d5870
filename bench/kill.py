"""Kill a capture at random moments, open what is left, and complete it.

    python bench/kill.py [--quick] [--json] [--moments 50] [--seed 0]

Each trial starts a capture of the simulated rig `toy` in a process of its own and ends it with SIGKILL:

* "call": before the n-th call that opens, makes, renames or removes something in the session folder;
* "line": when its standard output has told the n-th byte about finished shots;
* "time": a random time after the n-th finished shot, up to the time that a shot takes.

In every second trial the process that resumes is killed too, in what it still has to do. Then no shot
that was reported as finished may be lost, every record must have its whole file, and resuming must end
with the raw files and the truth of a capture that was never interrupted, byte for byte.

The full run writes bench/results/kill.md.
"""

import argparse
import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path

import numpy as np

from capture.recorder import leftovers
from capture.simulated import capture_simulated
from imaging import store
from imaging.errors import InputError
from imaging.session import Session

RIG, RIG_SEED, SHOTS = "toy", 7, 18
KINDS = ("call", "line", "time")
CALLS = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "shutil.rmtree"}


@dataclass
class Trial:
    """One session that was killed. failures: a sentence each; empty if nothing was lost."""

    seed: int
    moments: list[str] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    reported: int = 0
    recorded: int = 0
    retaken: int = 0
    failures: list[str] = field(default_factory=list)


@dataclass
class Reference:
    """A capture that was never interrupted: its files, its calls, the bytes that it told, its seconds."""

    files: dict[str, bytes]
    calls: int
    told: int
    seconds: float


# --- the process that is killed -------------------------------------------------------------------


def shoot(out: Path, kill_at_call: int) -> None:
    """Capture into `out`, or resume; tell the file of each finished shot; SIGKILL at the n-th call."""
    calls = 0

    def count(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal calls
        if event not in CALLS or not isinstance(arguments[0], str | os.PathLike):
            return
        if os.fspath(arguments[0]).startswith(f"{out}"):
            calls += 1
            if calls == kill_at_call:
                os.kill(os.getpid(), signal.SIGKILL)

    def tell(message: str, done: int, total: int) -> None:
        if message.startswith("raw/"):
            print(message, flush=True)

    print("ready", flush=True)
    sys.addaudithook(count)
    capture_simulated(RIG, out, seed=RIG_SEED, resume=out.exists(), progress=tell)
    print(f"calls {calls}", flush=True)


def start(out: Path, kill_at_call: int = 0) -> "subprocess.Popen[str]":
    """Start the process and wait until it is about to begin."""
    command = [sys.executable, __file__, "--shoot", str(out), "--kill-at-call", str(kill_at_call)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    if process.stdout.readline() != "ready\n":
        raise SystemExit("the capture did not start")
    return process


def shoot_and_kill(
    out: Path, kind: str, rng: np.random.Generator, left: float, reference: Reference
) -> tuple[str, list[str]]:
    """Kill at a random moment of the share `left` (0..1) of a capture: the moment, and the files it told."""
    call = int(rng.integers(1, 2 + int(left * reference.calls))) if kind == "call" else 0
    process = start(out, call)
    assert process.stdout is not None
    told = ""
    if kind == "call":
        moment = f"call {call}"
    elif kind == "line":
        count = int(rng.integers(0, 1 + int(left * reference.told)))
        told = process.stdout.read(count)
        moment = f"byte {count}"
    else:
        count = int(rng.integers(0, 1 + int(left * SHOTS)))
        seconds = float(rng.random()) * reference.seconds / SHOTS
        told = "".join(process.stdout.readline() for _ in range(count))
        with suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
        moment = f"shot {count} + {seconds * 1000:.0f} ms"
    if kind != "call":
        process.kill()
    told += process.stdout.read()
    process.stdout.close()
    if process.wait() not in (0, -signal.SIGKILL):
        raise SystemExit(f"the capture ended with {process.returncode}")
    complete = told[: told.rfind("\n") + 1].splitlines()
    return moment, [line for line in complete if line.startswith("raw/")]


# --- what is left -----------------------------------------------------------------------------------


def files_of(session: Path) -> dict[str, bytes]:
    """Everything that a session holds of raw files and truth."""
    paths = [p for part in ("raw", "truth") for p in sorted((session / part).rglob("*")) if p.is_file()]
    return {path.relative_to(session).as_posix(): path.read_bytes() for path in paths}


def state_of(out: Path) -> str:
    """In which part of its work the capture was killed."""
    if not (out / "session.json").exists():
        return "before the session"
    session = Session.open(out)
    shots = session.shots()
    if any("raw" in part.parts for part in leftovers(session)):
        return "in a file"
    if len(list((out / "raw").rglob("*.dng"))) > len(shots):
        return "between file and line"
    if len(shots) < SHOTS:
        return "between shots"
    return "at the end" if (out / "truth" / "truth.json").exists() else "in the truth"


def examine(out: Path, told: list[str], trial: Trial) -> None:
    """Every record has its whole file, and every shot that was told is recorded."""
    if not (out / "session.json").exists():
        if told:
            trial.failures.append(f"{len(told)} shots were told and there is no session")
        return
    session = Session.open(out)
    recorded = session.shots()
    for shot in recorded:
        path = session.file(shot)
        if not path.is_file() or store.sha256(path) != shot.sha256:
            trial.failures.append(f"{shot.file} is recorded and not whole")
    lost = sorted(set(told) - {shot.file for shot in recorded})
    if lost:
        trial.failures.append(f"finished and lost: {', '.join(lost)}")
    trial.recorded = len(recorded)


def run_trial(seed: int, folder: Path, reference: Reference) -> Trial:
    """Kill once or twice, examine, resume, compare."""
    rng = np.random.default_rng([seed, 20])
    out, trial, told = folder / f"trial-{seed}", Trial(seed), []
    for _ in range(1 + seed % 2):
        kind = KINDS[(seed + len(trial.moments)) % len(KINDS)]
        left = max(1 - trial.recorded / SHOTS, 0.2)  # the truth is a fifth of the work
        moment, files = shoot_and_kill(out, kind, rng, left, reference)
        told += files
        trial.moments.append(moment)
        trial.states.append(state_of(out))
        trial.reported = len(told)
        examine(out, told, trial)
    try:
        result = capture_simulated(RIG, out, seed=RIG_SEED, resume=out.exists())
    except InputError as error:
        trial.failures.append(f"cannot be resumed: {error}")
        return trial
    trial.retaken = result.taken
    if result.kept != trial.recorded or result.taken != SHOTS - trial.recorded:
        trial.failures.append(f"resuming took {result.taken} shots with {trial.recorded} recorded")
    if files_of(out) != reference.files:
        trial.failures.append("the files differ from those of a capture that was never interrupted")
    return trial


def make_reference(folder: Path) -> Reference:
    """The capture that all others are compared with; its time is that of a second, warm one."""
    for name in ("warm-up", "reference"):
        out = folder / name
        process = start(out)
        began = time.perf_counter()
        told, _ = process.communicate()
        seconds = time.perf_counter() - began
    *lines, last = told.splitlines(keepends=True)
    assert len(lines) == SHOTS
    return Reference(files_of(out), int(last.split()[1]), len("".join(lines)), seconds)


# --- the report -------------------------------------------------------------------------------------


def machine(folder: Path) -> dict[str, str]:
    """What the trials ran on."""
    mounts = [line.split()[1:3] for line in Path("/proc/mounts").read_text().splitlines()]
    home = max((m for m in mounts if folder.is_relative_to(m[0])), key=lambda mount: len(mount[0]))
    cpu = next(
        (
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if "model name" in line
        ),
        platform.machine(),
    )
    return {
        "cpu": f"{os.cpu_count()} x {cpu}",
        "system": f"{platform.system()} {platform.release()}, {home[1]}",
        "python": platform.python_version(),
        **{name: version(name) for name in ("hdr-rig", "numpy", "pydantic", "rawpy")},
    }


def as_table(summary: dict[str, object], trials: list[Trial]) -> str:
    """The committed result."""
    states = Counter(state for trial in trials for state in trial.states)
    lines = [
        "# A capture killed at random moments",
        "",
        f"`python bench/kill.py --moments {len(trials)}`: {summary['sessions']} sessions of {SHOTS} shots, "
        f"killed {summary['kills']} times; **{summary['lost_or_damaged']} lost or damaged a shot**, "
        f"{summary['completed']} were completed to the bytes of an uninterrupted capture.",
        "",
        "| killed | times |",
        "|---|---|",
        *(f"| {state} | {count} |" for state, count in sorted(states.items())),
        "",
        "| seed | moments | states | finished shots told | recorded | taken by the last run | failures |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {t.seed} | {', '.join(t.moments)} | {', '.join(t.states)} | {t.reported} | {t.recorded} "
            f"| {t.retaken} | {'; '.join(t.failures) or 'none'} |"
            for t in trials
        ),
        "",
        "```json",
        json.dumps(summary),
        "```",
        "",
    ]
    return "\n".join(lines)


def main() -> int:
    """Run the trials; 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moments", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0, help="of the first trial")
    parser.add_argument("--quick", action="store_true", help="five trials, and no result is written")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--shoot", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--kill-at-call", type=int, default=0, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.shoot is not None:
        shoot(options.shoot, options.kill_at_call)
        return 0
    count = 5 if options.quick else options.moments
    trials = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place).resolve()
        reference = make_reference(folder)
        for seed in range(options.seed, options.seed + count):
            trials.append(run_trial(seed, folder, reference))
            print(f"{len(trials)} of {count}: {asdict(trials[-1])}", file=sys.stderr)
        described = machine(folder)
    failed = [trial for trial in trials if trial.failures]
    summary = {
        "bench": "kill",
        "sessions": len(trials),
        "kills": sum(len(trial.moments) for trial in trials),
        "lost_or_damaged": len(failed),
        "completed": len(trials) - len(failed),
        "calls_of_a_capture": reference.calls,
        "seconds_of_a_capture": round(reference.seconds, 3),
        "seeds": [options.seed, options.seed + count - 1],
        "rig": f"{RIG}, seed {RIG_SEED}",
        "machine": described,
    }
    if not options.quick:
        from record import publish  # brings Numba, for which the killed children need not wait

        publish("kill", as_table(summary, trials))
    print(json.dumps(summary) if options.json else as_table(summary, trials))
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
