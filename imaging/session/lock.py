"""One writer a session and one maker a scene: two at once would overwrite each other's files."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from imaging.errors import InputError
from imaging.files import store


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Hold an existing folder for writing; InputError if another process does.

    The kernel lets go of the lock when the process ends, however it ends, and it leaves no file.
    A file system without locks is used without, and so is Windows, which cannot lock a folder.
    """
    says = f"{folder} is being written by another rig: wait for it to end, or name another folder."
    descriptor = _locked(folder, os.O_RDONLY, says)
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


@contextmanager
def sole_calibrator(session: Path) -> Iterator[None]:
    """Hold the calibration of a session, as `sole_maker` does.

    Where the session itself is read-only, only parts of the calibration can be made, inside its folder, which
    then holds the lock.

    Raises:
        InputError: another process holds the calibration.
        StorageError: the disk refuses.
    """
    folder = session / "calibration"
    with _held_by_file(session if os.access(session, os.W_OK) else folder, folder):
        yield


@contextmanager
def sole_maker(folder: Path) -> Iterator[None]:
    """Hold a folder of a session, such as `reconstructions/one`, that is made or replaced in the block.

    The lock is an empty file beside it that goes in the end; the kernel lets go of one that a killed process
    leaves. Systems and file systems without locks go without it.

    Raises:
        InputError: another process holds that folder.
        StorageError: the disk refuses.
    """
    with _held_by_file(folder.parent, folder):
        yield


@contextmanager
def _held_by_file(place: Path, folder: Path) -> Iterator[None]:
    """Hold `folder` by a file in `place`, which is made for that: NFS locks only what can be written."""
    lock = place / f".{folder.name}.lock"
    says = f"{folder} is being made by another rig: wait for it to end, or stop it."
    store.make_folder(place)
    try:
        descriptor = _locked(lock, os.O_RDWR | os.O_CREAT, says)
        while descriptor is not None and not _is_there(descriptor, lock):
            os.close(descriptor)
            descriptor = _locked(lock, os.O_RDWR | os.O_CREAT, says)
    except OSError as error:
        raise store.refused(lock, error) from error
    try:
        yield
    finally:
        if descriptor is not None:
            with suppress(OSError):
                lock.unlink()
            os.close(descriptor)


def _is_there(descriptor: int, path: Path) -> bool:
    """Return whether an open file still has its name: who held it may have removed it since it was opened."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _locked(path: Path, flags: int, says: str) -> int | None:
    """The open file or folder, which holds the lock; None on a system without `fcntl`.

    InputError with `says` if another process holds it.
    """
    try:
        import fcntl
    except ImportError:
        return None
    try:
        descriptor = os.open(path, flags, 0o666)
    except PermissionError:  # another user's, which a killed process may have left
        if not path.exists():
            raise
        descriptor = os.open(path, os.O_RDONLY)
    # NFS refuses to lock what is open for reading alone, but as one reader of several.
    for kind in (fcntl.LOCK_EX, fcntl.LOCK_SH):
        try:
            fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                os.close(descriptor)
                raise InputError(says) from error
            if error.errno == errno.EBADF:
                continue
        break
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
