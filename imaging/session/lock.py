"""One writer a session: two captures into one folder would overwrite each other's shots."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
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
