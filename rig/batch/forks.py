"""Commands as forks of one process that has imported the stages, which takes longer than a small session."""

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Mapping, Sequence
from importlib import import_module
from multiprocessing.connection import Connection
from typing import IO, Any

from imaging.compute.workers import Share

STAGES = [f"rig.commands.{name}" for name in ("calibrate", "reconstruct", "export")]
"""Modules of the commands that a plan runs; each imports its stage."""


Ending = tuple[int, Any]
"""Exit code, or minus the signal that killed the process; and the `resource.struct_rusage` of it and its
children, None where that is not known."""


def environment_of(share: Share) -> dict[str, str]:
    """Return the environment of a command, whose options are those of its words alone.

    An empty RIG_CONFIG keeps the user's own defaults (`rig/options/defaults.py`) out of a plan.
    """
    return os.environ | share.environment() | {"RIG_CONFIG": ""}


def run(share: Share, words: Sequence[str], out: IO[bytes], err: IO[bytes]) -> Ending:
    """Run `rig` with these words in a fork, its output into open files. Linux alone.

    Args:
        share: Part of the machine that the command keeps to.
        words: Arguments of the command line, without `rig` itself.
        out: File for the standard output.
        err: File for the standard error.

    Returns:
        How the command ended; as if killed by SIGKILL where its process ended without a word.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(STAGES)
    hears, tells = context.Pipe(duplex=False)
    environment = environment_of(share)
    streams = [f"/proc/{os.getpid()}/fd/{file.fileno()}" for file in (out, err)]
    process = context.Process(target=_wait, args=(words, environment, share, streams, tells))
    process.start()
    tells.close()
    command = None
    try:
        command = hears.recv()
        status, usage = hears.recv()
    except EOFError:
        return -signal.SIGKILL, None
    except BaseException:
        if command is not None:
            os.kill(command, signal.SIGKILL)
        raise
    finally:
        process.join()
        hears.close()
    return os.waitstatus_to_exitcode(status), usage


def _wait(
    words: Sequence[str],
    environment: Mapping[str, str],
    share: Share,
    streams: Sequence[str],
    tells: Connection,
) -> None:
    """Fork the command, and tell its process, its status and its usage, which only its parent learns."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command saves what it has, and ends
    command = os.fork()
    if command == 0:
        os._exit(_command(words, environment, share, streams))
    tells.send(command)
    tells.send(os.wait4(command, 0)[1:])


def _command(
    words: Sequence[str], environment: Mapping[str, str], share: Share, streams: Sequence[str]
) -> int:
    """Run the command; its exit code."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_batch, daemon=True).start()
    for descriptor, path in enumerate(streams, 1):
        os.dup2(os.open(path, os.O_WRONLY), descriptor)
    os.environ.clear()
    os.environ.update(environment)
    share.pin(0)
    try:
        code: int = import_module("rig.__main__").main(words)  # as `python -m rig` does
        return code
    except BaseException:  # with RIG_DEBUG=1
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()


def _end_with_batch() -> None:
    """A batch that is killed leaves no command behind, which would hold the session against the next run."""
    batch = multiprocessing.parent_process()
    assert batch is not None
    batch.join()
    os._exit(1)
