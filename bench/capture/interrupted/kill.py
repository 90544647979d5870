"""Kill a capture, fill its disk, pull out a camera, lock its folder; open what is left, and complete it.

    python -m bench.capture.interrupted.kill [--quick] [--json] [--write] [--trials 200] [--seed 0]

Each trial runs `rig capture` on the simulated rig `toy` in a process of its own, into trouble:

* killed: SIGKILL before the n-th call that opens, makes, renames or removes something in the session
  folder, after the n-th finished shot, or some time after it; in every second trial again when resumed;
* full disk: a file system of a few pages, or ENOSPC from the n-th of these calls on;
* removed camera: its cable comes out at the n-th byte of an answer, for ever;
* read-only folder: the file system is remounted after the n-th finished shot, or EROFS from the n-th call on.

Then no shot that was reported as finished may be lost, every record must have its whole file, `rig check`
must pass these and notice a flipped bit, what was not killed must have ended with exit code 3 (with shots
on the disk) or 2 (without) and one sentence, and resuming must end with the raw files and the truth of a
capture that was never in trouble, byte for byte. --write puts the table into bench/results/kill.md.
"""

import argparse
import json
import os
import platform
import sys
import tempfile
from collections import Counter
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from bench.capture.interrupted.trials import KINDS, Trial, make_reference, run_trial
from bench.capture.interrupted.trouble import RIG, RIG_SEED, SHOTS


def machine(folder: Path) -> dict[str, str]:
    """Return what the trials ran on."""
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
    lines = [
        "# A capture in trouble at random moments",
        "",
        f"`python -m bench.capture.interrupted.kill --write`: {summary['sessions']} sessions of {SHOTS} "
        f"shots, {summary['troubles']} times in trouble; **{summary['failed']} lost a finished shot, took a "
        f"wrong file or ended otherwise than they should**, {summary['completed']} were completed to the "
        "bytes of a capture without trouble.",
        "",
        "| trouble | sessions | shots finished before it | exit codes | ended | failures |",
        "|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        of_kind = [trial for trial in trials if trial.kind == kind]
        codes = Counter(code for trial in of_kind for code in trial.codes)
        states = Counter(state for trial in of_kind for state in trial.states)
        lines.append(
            f"| {kind} | {len(of_kind)} | {sum(trial.reported for trial in of_kind)} | {_counted(codes)} "
            f"| {_counted(states)} | {sum(bool(trial.failures) for trial in of_kind)} |"
        )
    lines += [
        "",
        *(
            f"Seed {trial.seed}, {trial.kind}, {', '.join(trial.moments)}: {failure}."
            for trial in trials
            for failure in trial.failures
        ),
        "```json",
        json.dumps(summary),
        "```",
        "",
    ]
    return "\n".join(lines)


def _counted(counts: Counter[int] | Counter[str]) -> str:
    return ", ".join(f"{count} x {what}" for what, count in sorted(counts.items(), key=str))


def main() -> int:
    """Run the trials; 1 if any failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first trial")
    for flag in ("--quick", "--json", "--write"):
        parser.add_argument(flag, action="store_true")
    options = parser.parse_args()
    count = 8 if options.quick else options.trials
    trials: list[Trial] = []
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
        "troubles": sum(len(trial.moments) for trial in trials),
        "failed": len(failed),
        "completed": len(trials) - len(failed),
        "calls_of_a_capture": reference.calls,
        "operations_of_a_capture": reference.operations,
        "seconds_of_a_capture": round(reference.seconds, 3),
        "seeds": [options.seed, options.seed + count - 1],
        "rig": f"{RIG}, seed {RIG_SEED}",
        "machine": described,
    }
    table = as_table(summary, trials)
    if options.write:
        from bench.support.record import publish  # brings Numba, for which the killed children need not wait

        publish("kill", table)
    print(json.dumps(summary) if options.json else table)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
