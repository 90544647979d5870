"""One capture that gets into trouble, what it left judged, and the session completed: for `kill`."""

import errno
import json
import signal
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.capture.interrupted.child import Trouble
from bench.capture.interrupted.trouble import (
    RIG,
    RIG_SEED,
    SHOTS,
    Capture,
    Reference,
    disk,
    full,
    killed,
    locked,
    refused,
    unlock,
    unplugged,
)
from capture.check.check import check
from capture.record.recorder import leftovers
from capture.simulated import capture_simulated
from imaging.errors import InputError
from imaging.files import store
from imaging.session.session import Session

KINDS = ("killed", "full disk", "removed camera", "read-only folder")


@dataclass
class Trial:
    """One session. codes: how what was in trouble ended; failures: a sentence each, empty if all is well."""

    seed: int
    kind: str = ""
    moments: list[str] = field(default_factory=list)
    codes: list[int] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    reported: int = 0
    recorded: int = 0
    failures: list[str] = field(default_factory=list)


# --- what is left -----------------------------------------------------------------------------------


def files_of(session: Path) -> dict[str, bytes]:
    """Contents of a session's raw files and truth, without the log of faults.

    The truth lists the exposures in the order in which they were recorded; here they are sorted.
    """
    paths = [p for part in ("raw", "truth") for p in sorted((session / part).rglob("*")) if p.is_file()]
    files = {p.relative_to(session).as_posix(): p.read_bytes() for p in paths if p.name != "faults.jsonl"}
    if truth := json.loads(files.get("truth/truth.json", b"null")):
        truth["exposures"].sort(key=lambda one: one["file"])
        files["truth/truth.json"] = json.dumps(truth, sort_keys=True).encode()
    return files


def state_of(out: Path) -> str:
    """Stage of its work at which the capture ended."""
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


def examine(out: Path, reported: list[str], trial: Trial, reference: Reference) -> None:
    """Check that every reported shot is recorded, every record has the right file, and `rig check` finds a
    wrong one.
    """
    trial.recorded = 0
    if not (out / "session.json").exists():
        if reported:
            trial.failures.append(f"{len(reported)} shots were reported and there is no session")
        return
    session = Session.open(out)
    recorded = session.shots()
    trial.recorded = len(recorded)
    for shot in recorded:
        path = session.file(shot)
        if not path.is_file() or store.sha256(path) != shot.sha256:
            trial.failures.append(f"{shot.file} is recorded and not whole")
        elif path.read_bytes() != reference.files[shot.file]:
            trial.failures.append(f"{shot.file} is recorded and another picture")
    lost = sorted(set(reported) - {shot.file for shot in recorded})
    if lost:
        trial.failures.append(f"finished and lost: {', '.join(lost)}")


def examine_check(out: Path, trial: Trial, rng: np.random.Generator) -> None:
    """`rig check` finds as many sound shots as there are, and one fewer if a bit of a file is flipped."""
    if not trial.recorded or trial.failures:
        return
    if (sound := check(out).sound) != trial.recorded:
        trial.failures.append(f"{sound} of {trial.recorded} whole shots pass the check")
    session = Session.open(out)
    path = session.file(session.shots()[int(rng.integers(trial.recorded))])
    data = path.read_bytes()
    wrong = bytearray(data)
    wrong[int(rng.integers(len(wrong)))] ^= 1 << int(rng.integers(8))
    path.write_bytes(wrong)
    if check(out).sound != trial.recorded - 1:
        trial.failures.append(f"a flipped bit in {path.name} passes the check")
    path.write_bytes(data)


def examine_exit(code: int, out: str, err: str, trial: Trial) -> None:
    """The exit code fits what is there, and what went wrong is one sentence."""
    right = 0 if code == 0 and trial.recorded == SHOTS else 3 if trial.recorded else 2
    if code != right:
        trial.failures.append(f"exit code {code} with {trial.recorded} shots recorded")
    if "Traceback" in err or (code != 0 and (err.count("\n") != 1 or not err.endswith(".\n"))):
        trial.failures.append(f"standard error is not one sentence: {err[-300:]!r}")
    value = json.loads(out) if code == 3 else {}
    if "taken" in value:  # else only the truth is missing
        if value["taken"] + value["earlier"] != trial.recorded:
            trial.failures.append(f"{value['taken']} shots reported, {trial.recorded} recorded")
        if len(value["missing_shots"]) != SHOTS - trial.recorded:
            trial.failures.append(f"{len(value['missing_shots'])} shots reported missing")
    elif code == 3 and trial.recorded < SHOTS:
        trial.failures.append(f"{SHOTS - trial.recorded} missing shots are not reported")


def complete(out: Path, trial: Trial, reference: Reference) -> None:
    """Resuming takes exactly what is not there, and ends with the bytes of a capture without trouble."""
    try:
        result = capture_simulated(RIG, out, seed=RIG_SEED, resume=out.exists())
    except InputError as error:
        trial.failures.append(f"cannot be resumed: {error}")
        return
    if result.earlier != trial.recorded or result.taken != SHOTS - trial.recorded:
        trial.failures.append(f"resuming took {result.taken} shots with {trial.recorded} recorded")
    if files_of(out) != reference.files:
        trial.failures.append("the files differ from those of a capture that was never in trouble")


# --- trials -----------------------------------------------------------------------------------------


def run_trial(seed: int, folder: Path, reference: Reference) -> Trial:
    """One session in trouble of the kind that its seed says.

    In every second trial the process that resumes a killed one is killed too, and a full or read-only
    disk is a file system of its own, where that may be mounted, rather than errors in its place.
    """
    rng = np.random.default_rng([seed, 20])
    trial, turn = Trial(seed, KINDS[seed % len(KINDS)]), seed // len(KINDS)
    out = folder / f"trial-{seed}" / "S"
    out.parent.mkdir()
    with ExitStack() as stack:
        mounted = trial.kind in KINDS[1::2] and turn % 2 == 0 and stack.enter_context(disk(out.parent))
        reported: list[str] = []
        for strike in range(1 + turn % 2 if trial.kind == "killed" else 1):
            if trial.kind == "killed":
                remaining = max(1 - trial.recorded / SHOTS, 0.2)  # the truth is a fifth of the work
                moment, capture = killed(out, (turn + strike) % 3, remaining, rng, reference)
            elif trial.kind == "removed camera":
                moment, capture = unplugged(out, rng, reference)
            elif mounted:
                moment, capture = full(out, rng, reference) if "full" in trial.kind else locked(out, rng)
            else:
                number = errno.ENOSPC if "full" in trial.kind else errno.EROFS
                moment, capture = refused(out, number, rng, reference)
            _judge(out, trial, moment, capture, reported, reference)
        if mounted:
            unlock(out.parent)
        examine_check(out, trial, rng)
        complete(out, trial, reference)
    return trial


def _judge(
    out: Path, trial: Trial, moment: str, capture: Capture, reported: list[str], reference: Reference
) -> None:
    code, printed, err = capture.finish()
    reported += capture.reported
    trial.moments.append(moment)
    trial.codes.append(code)
    trial.reported = len(reported)
    trial.states.append(state_of(out))
    examine(out, reported, trial, reference)
    if code != -signal.SIGKILL:
        examine_exit(code, printed, err, trial)


def make_reference(folder: Path) -> Reference:
    """The capture that all others are compared with; its time is that of a second, warm one."""
    for name in ("warm-up", "reference"):
        out = folder / name / "S"
        out.parent.mkdir()
        began = time.perf_counter()
        capture = Capture(Trouble(out))
        code, _, err = capture.finish()
        seconds = time.perf_counter() - began
        if code != 0 or len(capture.reported) != SHOTS:
            raise SystemExit(f"a capture without trouble ended with {code}: {err}")
    return Reference(files_of(out), *capture.counts, seconds)
