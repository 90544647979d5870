"""Intermediate results of a calibration, kept beside the session until it is written, so that a stopped one
resumes.
"""

import hashlib
import io
import json
import time
import zipfile
from pathlib import Path

import numpy as np

from imaging.arrays import AnyArray
from imaging.files import store

Arrays = dict[str, AnyArray]

FOLDER = ".calibration.unfinished"
EVERY = 30.0
"""Seconds of matching, or of placing views, after which what is done is written."""


class Unfinished:
    """Arrays by name, found once; in memory, and in files as soon as there is a folder.

    Everything is for one question: what was kept for another is thrown away. A damaged file counts for
    nothing. StorageError where the disk refuses.
    """

    def __init__(self, session: Path | None = None, question: object = None) -> None:
        self._folder = None if session is None else session / FOLDER
        self._few: Arrays = {}
        self._known: Arrays = {}
        self._since = time.monotonic()
        if self._folder is None:
            return
        asked = hashlib.sha256(json.dumps(question, sort_keys=True, default=str).encode()).hexdigest()
        question_file = self._folder / "question"
        if not question_file.is_file() or question_file.read_bytes() != asked.encode():
            store.discard(self._folder)
            store.make_folder(self._folder)
            store.write_bytes(question_file, asked.encode())
        for file in sorted(self._folder.glob("few-*.npz")):
            self._known |= _read(file) or {}

    @property
    def in_files(self) -> bool:
        """True if what is kept outlives the process."""
        return self._folder is not None

    def large(self, name: str) -> Arrays | None:
        """Return a stored result that takes seconds and much room, or None."""
        return None if self._folder is None else _read(self._file(name))

    def keep_large(self, name: str, arrays: Arrays) -> None:
        """Store a large result in its own file, without caching it in memory."""
        if self._folder is not None:
            store.write_bytes(self._file(name), _written(arrays))

    def small(self, name: str) -> AnyArray | None:
        """Return a stored result that is one of many, or None."""
        return self._known.get(name)

    def keep(self, name: str, array: AnyArray) -> None:
        """Keep what is one of many: in memory, and written some at a time; `flush` writes the rest."""
        if name not in self._known:
            self._known[name] = self._few[name] = array
            if time.monotonic() - self._since > EVERY:
                self.flush()

    def flush(self) -> None:
        """Write what is in memory alone."""
        if self._folder is not None and self._few:
            number = len(list(self._folder.glob("few-*.npz")))
            store.write_bytes(self._folder / f"few-{number:05d}.npz", _written(self._few))
        self._few, self._since = {}, time.monotonic()

    def _file(self, name: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{hashlib.sha256(name.encode()).hexdigest()[:24]}.npz"

    def finish(self) -> None:
        """Forget it all, since what it was for is written."""
        if self._folder is not None:
            store.discard(self._folder)


def _written(arrays: Arrays) -> bytes:
    whole = io.BytesIO()
    np.savez(whole, **arrays)  # type: ignore[arg-type]
    return whole.getvalue()


def _read(file: Path) -> Arrays | None:
    """None of a file that is not there, or not whole."""
    try:
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, KeyError):
        return None
