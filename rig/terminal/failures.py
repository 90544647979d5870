"""Failures on the command line: one sentence and an exit code.

Exit codes: 0 done; 1 a defect of rig; 2 the input or the usage is at fault and nothing usable came
out; 3 done in part; 130 stopped by Ctrl-C (128 + SIGINT, as shells expect).
"""

import errno
import os
import platform
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from typer import Abort, TyperException

from imaging.errors import RigError, StorageError
from imaging.files import store
from rig.terminal.text import command_line, sentence

STOPPED = 130

_DISK = {errno.ENOSPC, errno.EROFS, errno.EDQUOT, errno.EFBIG}
_PLACE = {
    errno.EACCES,
    errno.EPERM,
    errno.ENOENT,
    errno.EEXIST,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.ENAMETOOLONG,
    errno.ELOOP,
    errno.ENOTEMPTY,
    errno.EIO,
    errno.ESTALE,
}


class Stopped(RigError):
    """The user pressed Ctrl-C; the message says how to go on."""

    exit_code: ClassVar[int] = STOPPED


def explained(error: BaseException, words: Sequence[str] = ()) -> tuple[str, int]:
    """The sentence for a failure, and the exit code. words: of the command, for the report of a defect."""
    if isinstance(error, RigError):
        return sentence(error), error.exit_code
    if isinstance(error, TyperException):
        return _usage(error), 2
    if isinstance(error, KeyboardInterrupt | Abort):
        return "stopped before anything was done.", STOPPED
    if isinstance(error, OSError):
        refusal = _disk(error)
        if refusal is not None:
            return refusal, 2
    if isinstance(error, MemoryError) or "allocate memory" in str(error):
        return "There is not enough memory: use fewer or smaller images, or --quality draft.", 2
    return _defect(error, words), 1


def _usage(error: TyperException) -> str:
    """Report a wrong command line in one sentence, without the usage page."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "rig"
    message = error.format_message().replace("Value error, ", "").strip().rstrip(".")
    return sentence(f"{command}: {message[:1].lower()}{message[1:]}; see `{command} --help`")


def _disk(error: OSError) -> str | None:
    """A refusal of the disk that no stage translated; None if it is not about a file."""
    reason = (error.strerror or str(error)).lower()
    name = error.filename if error.filename is not None else "the disk"
    if error.errno in _DISK:
        return sentence(store.refused(name, error))
    if error.errno in _PLACE and error.filename is not None:
        return sentence(f"{name} cannot be used ({reason}): correct the path or its permissions")
    return None


def _defect(error: BaseException, words: Sequence[str]) -> str:
    """Our own fault: the traceback goes to a file, with what was done, for the report to us."""
    from importlib.metadata import version  # a tenth of the time that `rig --help` would take

    path = Path(tempfile.gettempdir()) / f"rig-defect-{os.getpid()}.txt"
    doing = "; ".join(getattr(error, "__notes__", ()))
    head = (
        f"command: {command_line('rig', *words)}",
        f"folder: {_folder()}",
        f"doing: {doing or 'before the work or after it'}",
        f"rig {version('hdr-rig')}, Python {platform.python_version()}, {platform.platform()}",
    )
    text = "\n".join((*head, "", "".join(traceback.format_exception(error))))
    try:
        store.write_bytes(path, text.encode("utf-8", "backslashreplace"))
        where = f"the details are in {path}"
    except StorageError:
        where = "run it again with RIG_DEBUG=1 for the details"
    while_doing = f" in {doing}" if doing else ""
    return sentence(
        f"This is a defect of rig, not of your input ({type(error).__name__}{while_doing}): {where}"
    )


def _folder() -> str:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return "one that is no longer there"
