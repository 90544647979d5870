"""One writer a session: two captures into one folder would overwrite each other's shots."""

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from imaging.errors import InputError


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Hold an existing folder for writing; InputError if another process does.

    The kernel lets go of the lock when the process ends, however it ends, and it leaves no file.
    A file system without locks is used without.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                raise InputError(
                    f"{folder} is being written by another rig: wait for it to end, or name another folder."
                ) from error
        yield
    finally:
        os.close(descriptor)
