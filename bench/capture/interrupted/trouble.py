"""`rig capture` in a process of its own, and the trouble that it gets into; see kill.py."""

import errno
import multiprocessing
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.capture.interrupted.child import Trouble, run

RIG, RIG_SEED, SHOTS = "toy", 7, 18
SERIALS = ("SIM-RAW-001", "SIM-RAW-002")
PAGE, LARGE = 4096, "64m"
LIMIT = 60.0
"""Seconds after which a capture counts as hanging."""
_FORKS = multiprocessing.get_context("forkserver")
_FORKS.set_forkserver_preload(["bench.capture.interrupted.child", "capture.simulated"])
"""Children of a process that has read all modules and done nothing yet."""


@dataclass
class Reference:
    """A capture that was never in trouble: its files, calls, operations of both cameras, seconds a shot."""

    files: dict[str, bytes]
    calls: int
    operations: int
    seconds: float

    def pages(self, part: str = "") -> int:
        """Pages of a disk with the files of this prefix."""
        return sum(-(-len(data) // PAGE) for name, data in self.files.items() if name.startswith(part))


class Capture:
    """`rig capture` in a separate process: `reported` holds the shots that it reported as finished."""

    def __init__(self, trouble: Trouble) -> None:
        out = trouble.folder
        command = ["capture", "--sim", RIG, str(out), "--seed", str(RIG_SEED), "--json"]
        command += ["--resume"] if out.exists() else []
        self._streams = [out.parent.with_suffix(end) for end in (".out", ".err")]
        self._pipe, writing = _FORKS.Pipe(duplex=False)
        self._process = _FORKS.Process(target=run, args=(trouble, command, writing, *self._streams))
        self._process.start()
        writing.close()
        self.reported: list[str] = []
        self.counts = (0, 0)

    def read(self, count: int = -1) -> None:
        """Wait for that many more finished shots, or for the end."""
        with suppress(EOFError):
            while count:
                heard = self._pipe.recv()
                if isinstance(heard, tuple):
                    self.counts = heard
                    return
                self.reported.append(heard)
                count -= 1

    def running(self, seconds: float) -> bool:
        """Return whether it still runs after that many seconds."""
        self._process.join(seconds)
        return self._process.exitcode is None

    def kill(self) -> None:
        """SIGKILL."""
        self._process.kill()

    def finish(self) -> tuple[int, str, str]:
        """Exit code, standard output and error; SystemExit if it hangs."""
        if self.running(LIMIT):
            self.kill()
            raise SystemExit(f"a capture hangs for {LIMIT:g} s")
        self.read()
        self._pipe.close()
        assert self._process.exitcode is not None
        out, err = (stream.read_text() if stream.exists() else "" for stream in self._streams)
        for stream in self._streams:
            stream.unlink(missing_ok=True)
        return self._process.exitcode, out, err


# --- trouble ----------------------------------------------------------------------------------------


def killed(
    out: Path, kind: int, remaining: float, rng: np.random.Generator, reference: Reference
) -> tuple[str, Capture]:
    """Send SIGKILL at a call in the folder, after a reported shot or some time after one, in the share
    `remaining`.
    """
    if kind == 0:
        call = int(rng.integers(1, 2 + int(remaining * reference.calls)))
        return f"call {call}", Capture(Trouble(out, die=call))
    count = int(rng.integers(0, 1 + int(remaining * SHOTS)))
    seconds = float(rng.random()) * reference.seconds / SHOTS if kind == 1 else 0.0
    capture = Capture(Trouble(out))
    capture.read(count)
    capture.running(seconds)
    capture.kill()
    return f"shot {count} + {1000 * seconds:.0f} ms", capture


@contextmanager
def disk(folder: Path) -> Iterator[bool]:
    """A file system of its own at `folder`; False where that is not permitted."""
    mounted = _does(["mount", "-t", "tmpfs", "-o", f"size={LARGE}", "none", str(folder)])
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(folder)], check=True)


def _does(command: list[str]) -> bool:
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def unlock(folder: Path) -> None:
    """Make the file system large and writable again."""
    remount(folder, "rw", f"size={LARGE}")


def remount(folder: Path, *options: str) -> bool:
    """Return whether the file system took the options."""
    return _does(["mount", "-o", ",".join(("remount", *options)), str(folder)])


def full(out: Path, rng: np.random.Generator, reference: Reference) -> tuple[str, Capture]:
    """Fewer pages than the session needs: most are full within the raw files, some in the truth."""
    most = reference.pages() if rng.random() < 0.2 else reference.pages("raw") + 8
    pages = int(rng.integers(1, most))
    remount(out.parent, f"size={pages * PAGE}")
    return f"{pages * PAGE // 1024} kB", Capture(Trouble(out))


def locked(out: Path, rng: np.random.Generator) -> tuple[str, Capture]:
    """Make the file system read-only after a reported shot; not while a file is open, hence the loop."""
    count = int(rng.integers(0, SHOTS + 1))
    capture = Capture(Trouble(out))
    capture.read(count)
    while not remount(out.parent, "ro") and capture.running(0.001):
        pass
    return f"remounted after shot {count}", capture


def refused(out: Path, number: int, rng: np.random.Generator, reference: Reference) -> tuple[str, Capture]:
    """Let writing fail with that error from a call in the folder on."""
    call = int(rng.integers(1, 1 + reference.calls))
    return f"{errno.errorcode[number]} from call {call}", Capture(Trouble(out, refuse=call, number=number))


def unplugged(out: Path, rng: np.random.Generator, reference: Reference) -> tuple[str, Capture]:
    """A camera loses its cable somewhere in the answer to one of its operations, for ever."""
    serial = SERIALS[int(rng.integers(2))]
    nth, count = int(rng.integers(1, 1 + reference.operations // 2)), int(rng.integers(1, 7000))
    return f"{serial}, operation {nth}, byte {count}", Capture(Trouble(out, unplug=(serial, nth, count)))
