"""One writer a session: two captures into one folder would overwrite each other's shots."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from imaging.errors import InputError


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Hold an existing folder for writing; InputError if another process does.

    The kernel lets go of the lock when the process ends, however it ends, and it leaves no file.
    A file system without locks is used without, and so is Windows, which cannot lock a folder.
    """
    descriptor = _locked(folder)
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _locked(folder: Path) -> int | None:
    """The open folder, which holds the lock; None on a system without `fcntl`."""
    try:
        import fcntl
    except ImportError:
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            os.close(descriptor)
            raise InputError(
                f"{folder} is being written by another rig: wait for it to end, or name another folder."
            ) from error
    return descriptor


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Show others that this process is at work in an existing folder, until it ends, however it ends.

    The lock is advisory: it prevents no writing. Systems and file systems without locks go without it.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_SH)  # others ask for a moment: it waits for them
        yield
    finally:
        os.close(descriptor)


def is_held(folder: Path) -> bool:
    """Return whether a process is at work in a folder, as `held` shows it; no where that cannot be seen."""
    try:
        import fcntl

        descriptor = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EWOULDBLOCK, errno.EACCES)
    finally:
        os.close(descriptor)
    return False
