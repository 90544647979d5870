"""`rig` in a process of its own that is in for trouble; see kill.py."""

import errno
import math
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from unittest.mock import patch

from drivers.clock import Clock
from drivers.sim import bus_rig
from drivers.sim.faults import Fault, FaultPlan, Kind, Mix
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from rig.__main__ import main as rig
from rig.terminal import progress

CALLS = {"open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "shutil.rmtree"}
FOR_EVER = 1e9
"""Seconds after which a camera that is pulled out comes back."""


@dataclass(frozen=True)
class Trouble:
    """Faults of a run. Calls are those that open, make, rename or remove something in `folder`, from 1.

    die: SIGKILL at that call; refuse: from that call on, those that write fail with the errno `number`;
    unplug: serial, which of its operations, and after how many bytes of the answer.
    """

    folder: Path
    die: int = 0
    refuse: int = 0
    number: int = 0
    unplug: tuple[str, int, int] | None = None


def run(trouble: Trouble, arguments: Sequence[str], tell: Connection, out: Path, err: Path) -> None:
    """Run the command line in this process, its streams into files, and leave with its exit code.

    `tell` receives the file of every shot once its record is on the disk, and at the end the number of calls
    and of operations requested of the cameras.
    """
    for path, descriptor in ((out, 1), (err, 2)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), descriptor)
    progress.GRACE = math.inf  # standard error has nothing but what went wrong
    append = Session.append_shot

    def append_and_tell(session: Session, shot: ShotRecord) -> None:
        append(session, shot)
        tell.send(shot.file)

    plans: list[FaultPlan] = []

    def plan(clock: Clock, faults: Sequence[Fault], mix: Mix | None, seed: int) -> FaultPlan:
        if trouble.unplug is not None:
            serial, nth, count = trouble.unplug
            faults = [Fault(Kind.UNPLUG, serial, nth=nth, seconds=FOR_EVER, count=count)]
        plans.append(FaultPlan(clock, faults, mix, seed))
        return plans[-1]

    # Nothing puts them back: the process ends with what it does here.
    patch.object(Session, "append_shot", append_and_tell).start()
    patch.object(bus_rig, "FaultPlan", plan).start()
    calls = _watch(trouble)
    code = rig(arguments)
    tell.send((calls[0], sum(one.operations() for one in plans)))
    raise SystemExit(code)


def _watch(trouble: Trouble) -> list[int]:
    """Count the calls from here on, and have what is to happen happen."""
    calls = [0]

    def watch(event: str, arguments: tuple[object, ...]) -> None:
        if event not in CALLS or not isinstance(arguments[0], str | bytes | os.PathLike):
            return
        path = os.fsdecode(arguments[0])
        if not path.startswith(str(trouble.folder)):
            return
        calls[0] += 1
        if calls[0] == trouble.die:
            os.kill(os.getpid(), signal.SIGKILL)
        if 0 < trouble.refuse <= calls[0] and _writes(event, arguments, trouble.number):
            raise OSError(trouble.number, os.strerror(trouble.number), path)

    sys.addaudithook(watch)
    return calls


def _writes(event: str, arguments: tuple[object, ...], number: int) -> bool:
    """Reading always goes on; a full disk still removes and renames, a read-only one does not."""
    if event == "open":
        flags = arguments[2]
        return isinstance(flags, int) and bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    return event == "os.mkdir" or number == errno.EROFS
