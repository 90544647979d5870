"""The first moments of a session: its folder is made, or left as if nothing had happened."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from imaging.errors import InputError, StorageError
from imaging.files import store
from imaging.session.records import SessionRecord
from imaging.session.session import Session


def must_be_no_file(folder: Path) -> None:
    """InputError if a file is in the way of a folder."""
    for path in (folder, *folder.parents):
        if path.exists() and not path.is_dir():
            raise InputError(f"{path} is a file: name a new folder.")


@contextmanager
def folder_made(folder: Path) -> Iterator[None]:
    """Make a folder and its parents; those still empty when the block fails are removed again.

    InputError if a file is in the way.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    must_be_no_file(folder)
    try:
        store.make_folder(folder)
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):  # not empty: something worth keeping is in it
                path.rmdir()
        raise


def is_vacant(folder: Path) -> bool:
    """Return whether a session may begin there: nothing there, or only what a killed write left."""
    if not folder.exists():
        return True
    return folder.is_dir() and set(folder.iterdir()) == set(store.leftovers(folder))


def begin(folder: Path, record: SessionRecord) -> Session:
    """Write session.json into a vacant folder; InputError if it is not vacant."""
    if not is_vacant(folder):
        raise InputError(f"{folder} is not empty: name a new folder, or --resume the session in it.")
    for leftover in store.leftovers(folder):
        store.discard(leftover)
    try:
        return Session.create(folder, record)
    except StorageError:
        with suppress(StorageError):
            store.discard(folder / "session.json")  # renamed, but perhaps not on the disk
        raise
