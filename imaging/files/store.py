"""Files that are either there whole or not at all; every write of `rig` goes through this module.

A file is written beside its place as `.part`, synced and renamed. A line of a `.jsonl` is appended
and synced; a torn last line is dropped when the file is opened again.
"""

import errno
import hashlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BufferedRandom
from pathlib import Path, PurePosixPath
from typing import Any

from imaging.errors import InputError, StorageError

_ASIDE = ".old.part"
"""End of the name of a folder that steps aside for its successor."""


def sync(path: Path) -> None:
    """Force a file or a folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


_FIXES = {
    errno.ENOSPC: "free some space on the disk and run again",
    errno.EDQUOT: "free some of the space that is yours on the disk and run again",
    errno.EROFS: "name a place on a disk that can be written to",
    errno.EACCES: "change its permissions, or name a place of your own",
    errno.EPERM: "change its permissions, or name a place of your own",
    errno.EEXIST: "a file is in its place, so remove that or use another name",
    errno.ENOTDIR: "a file is in the place of a folder, so remove that or use another name",
    errno.EISDIR: "a folder is in its place, so remove that or use another name",
    errno.ENAMETOOLONG: "use a shorter name",
}


def refused(path: Path | str, error: OSError) -> StorageError:
    """Return the message for a disk that refused to write a path: what, where, and the fix by the reason."""
    reason = (error.strerror or str(error)).lower()
    fix = _FIXES.get(error.errno or 0, "check the disk and run again")
    return StorageError(f"{path} could not be written ({reason}): {fix}.")


def require_writable(folder: Path) -> None:
    """StorageError unless files can be written into a folder, to be made or there already; leaves nothing."""
    try:
        place = next(one for one in (folder, *folder.parents) if one.exists())
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise refused(folder, error) from error


def _unreadable(path: Path, error: OSError) -> InputError:
    reason = (error.strerror or str(error)).lower()
    return InputError(f"{path} cannot be read ({reason}): correct the path or its permissions.")


def make_folder(path: Path) -> None:
    """Create a folder and its parents and sync them; StorageError when the disk refuses."""
    try:
        missing = [folder for folder in (path, *path.parents) if not folder.is_dir()]
        path.mkdir(parents=True, exist_ok=True)
        for folder in missing:
            sync(folder.parent)
    except OSError as error:
        raise refused(path, error) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to; when the block ends well, the file is synced and takes the place of `path`.

    If the block fails, or the disk does, nothing is left and the old file stays. OSError becomes
    StorageError. Works for a folder too: create the yielded path as a folder and fill it.
    """
    part = path.with_name(f".{path.name}.part")
    make_folder(path.parent)
    try:
        _discard(part)
        yield part
        for file in [*part.rglob("*"), part]:
            if file.is_file() or file.is_dir():
                sync(file)
        if part.is_dir():
            _replace_folder(part, path)
        else:
            part.replace(path)
        sync(path.parent)
    except OSError as error:
        with suppress(OSError):  # a disk that refuses to write may refuse to delete
            _discard(part)
        raise refused(path, error) from error
    except BaseException:
        with suppress(OSError):
            _discard(part)
        raise


def _replace_folder(part: Path, path: Path) -> None:
    """Rename `part` to `path`; what was there steps aside first, and comes back if that fails."""
    old = path.with_name(f".{path.name}{_ASIDE}")
    _bring_back(old)
    _discard(old)
    stepped_aside = path.exists()
    if stepped_aside:
        path.rename(old)
    try:
        part.rename(path)
    except BaseException:
        if stepped_aside:
            old.rename(path)
        raise
    with suppress(OSError):  # the new folder is in its place: a leftover is no failure
        _discard(old)


def _bring_back(old: Path) -> None:
    """Undo a replacement that was killed between its two renames: `old` returns to its empty place."""
    path = old.with_name(old.name.removeprefix(".").removesuffix(_ASIDE))
    if old.exists() and not path.exists():
        old.rename(path)


def leftovers(folder: Path) -> list[Path]:
    """Return what killed writes left directly in a folder: its `.part` files and folders.

    A folder that had stepped aside for one that never came is no leftover: it is put back first.
    """
    try:
        for old in folder.glob(f".*{_ASIDE}"):
            _bring_back(old)
    except OSError as error:
        raise refused(folder, error) from error
    return sorted(folder.glob(".*.part"))


def discard(path: Path) -> None:
    """Remove a leftover; StorageError when the disk refuses."""
    try:
        _discard(path)
    except OSError as error:
        raise refused(path, error) from error


def rename(path: Path, new: Path) -> None:
    """Give a file another name in its folder, in place of what has it; StorageError when the disk refuses."""
    try:
        path.replace(new)
        sync(path.parent)
    except OSError as error:
        raise refused(path, error) from error


def _discard(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def replace_folder(new: Path, path: Path) -> None:
    """Put a folder in the place of another, which steps aside first and comes back if that fails."""
    try:
        _replace_folder(new, path)
        sync(path.parent)
    except OSError as error:
        raise refused(path, error) from error


def write_bytes(path: Path, data: bytes) -> None:
    """Write a whole file, or nothing."""
    with replacing(path) as part:
        part.write_bytes(data)


def write_pieces(path: Path, pieces: Iterable[bytes | memoryview]) -> None:
    """Write a whole file, or nothing, from pieces without joining them in memory.

    For large files that are not read soon: the system's cache drops them.
    """
    with replacing(path) as part, part.open("wb") as file:
        for piece in pieces:
            file.write(piece)
    _uncache(path)


def _uncache(path: Path) -> None:
    """Give the memory of a synced file's cache back: to reclaim it later costs more than writing the file."""
    if sys.platform != "linux":
        return
    with suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(descriptor)


def scratch(folder: Path) -> BufferedRandom:
    """A file in a folder that has no name and goes when it is closed, or the process ends however it does.

    StorageError when the disk refuses; what is written to it later is the caller's to catch.
    """
    try:
        return tempfile.TemporaryFile(dir=folder)
    except OSError as error:
        raise refused(folder, error) from error


def write_json(path: Path, value: Any) -> None:
    """Write a value as indented JSON; NaN and infinities are refused (ValueError)."""
    write_bytes(path, (json.dumps(value, indent=1, allow_nan=False) + "\n").encode())


def append_line(path: Path, value: Any) -> None:
    """Append one JSON line and sync it; a torn line left by a crash is cut off first."""
    line = (json.dumps(value, allow_nan=False) + "\n").encode()
    try:
        new = not path.exists()
        with path.open("ab+") as file:
            end = file.seek(0, os.SEEK_END)
            if end:
                file.seek(end - 1)
                if file.read(1) != b"\n":
                    file.truncate(path.read_bytes().rfind(b"\n") + 1)
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        if new:
            sync(path.parent)
    except OSError as error:
        raise refused(path, error) from error


def read_lines(path: Path) -> list[Any]:
    """The values of a `.jsonl` file; a torn last line is dropped, a damaged line is an InputError."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise _unreadable(path, error) from error
    values = []
    for number, line in enumerate(data[: data.rfind(b"\n") + 1].splitlines(), start=1):
        try:
            values.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}, line {number} is not JSON: restore it or delete the line.") from error
    return values


def read_json(path: Path) -> Any:
    """The value of a JSON file; InputError when it is missing or damaged."""
    try:
        return json.loads(path.read_bytes())
    except FileNotFoundError as error:
        raise InputError(f"{path} is missing: run the stage that writes it first.") from error
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path} cannot be read as JSON: restore it or run its stage again.") from error


def sha256(path: Path) -> str:
    """Hex digest of a file's bytes; InputError if it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise _unreadable(path, error) from error


def inside(folder: Path, relative: str) -> Path:
    """The path of `relative` in `folder`; InputError if it would leave the folder."""
    pure = PurePosixPath(relative)
    path = folder / pure
    try:
        nameable = all(len(os.fsencode(part)) <= 255 for part in pure.parts)
        within = path.resolve().is_relative_to(folder.resolve())
    except (ValueError, OSError, RuntimeError):
        # a character that no file name can have, or links that lead in a circle
        nameable = within = False
    if pure.is_absolute() or ".." in pure.parts or not nameable or not within:
        raise InputError(f"{relative!r} leads out of {folder}: correct the record that names it.")
    return path
