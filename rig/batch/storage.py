"""Sessions in object storage: copied here with their hashes checked, and results stored beside a manifest."""

import errno
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from imaging.errors import InputError, RigError
from imaging.files import store
from imaging.record import Record
from imaging.session.session import SESSION, Session
from rig.batch.result import EXPORTS, BatchRow

MANIFEST = "manifest.json"
RECORDS = (SESSION, "plans.jsonl", "shots.jsonl", "split.json")
CALIBRATION = "calibration/calibration.json"
RESULTS = ("calibration", "reconstructions", EXPORTS)
"""Folders of a session that are stored, with the files beside them."""


class Manifest(Record):
    """`manifest.json`: written after all files of a stored session, so that those it names are whole.

    source: URL of the session. shots_sha256: of its shots.jsonl there, as the scenes were made of it; empty
    where none is made. files: SHA-256 of each, by its path from the manifest's folder. rows: scenes that are
    made, with paths from there too.
    """

    source: str
    shots_sha256: str = ""
    files: dict[str, str] = Field(default_factory=dict)
    rows: tuple[BatchRow, ...] = ()


@dataclass(frozen=True)
class Place:
    """A session in storage. source: its URL, only read. target: URL of the folder of its results."""

    source: str
    target: str

    def manifest(self) -> Manifest:
        """Read what is stored of the session; an empty manifest where nothing is, or a store was killed.

        Raises:
            InputError: the storage cannot be read, or the manifest is damaged or that of another session.
        """
        with _speaking(self.target):
            system, root = _opened(self.target)
            try:
                text = system.cat_file(f"{root}/{MANIFEST}")
            except FileNotFoundError:
                return Manifest(source=self.source)
        try:
            manifest = Manifest.model_validate_json(text)
        except ValueError:
            raise InputError(
                f"{self.target}/{MANIFEST} is damaged: delete it, and its scenes are made again."
            ) from None
        if manifest.source.rstrip("/") != self.source.rstrip("/"):
            raise InputError(
                f"{self.target} holds what was made of {manifest.source}: "
                "give this plan an output of its own."
            )
        return manifest

    def shots_sha256(self) -> str:
        """Hash the session's shots.jsonl in storage.

        Raises:
            InputError: the storage cannot be read, or has no session there.
        """
        with _speaking(self.source):
            system, root = _opened(self.source)
            return hashlib.sha256(system.cat_file(f"{root}/shots.jsonl")).hexdigest()

    def fetch_records(self, session: Path, names: Sequence[str] = (*RECORDS, CALIBRATION)) -> None:
        """Copy the records of the session, which say how much work it is, into a folder here.

        Args:
            session: the folder here.
            names: of those records that are copied where they exist.

        Raises:
            InputError: the storage cannot be read, or has no session there.
        """
        with _speaking(self.source):
            system, root = _opened(self.source)
            for name in names:
                if system.exists(f"{root}/{name}"):
                    _copy(system, f"{root}/{name}", session / name, None, f"{self.source}/{name}")

    def fetch(self, session: Path) -> None:
        """Copy the session and what is stored of it into a folder here, but for what the folder has.

        Raises:
            InputError: the storage cannot be read, or a file is missing or differs from the hash in
                shots.jsonl or the manifest.
        """
        self.fetch_records(session, RECORDS)
        hashes = _hashes(session)
        with _speaking(self.target):
            system, root = _opened(self.target)
            for name, digest in self.manifest().files.items():
                path = store.inside(session, name)
                if not path.exists():
                    again = f"delete {MANIFEST} there, and its scenes are made again"
                    _copy(system, f"{root}/{name}", path, digest, f"{self.target}/{name}", again)
        with _speaking(self.source):
            system, root = _opened(self.source)
            names = {path[len(root) + 1 :] for path in system.find(root)}
            if missing := sorted(hashes.keys() - names):
                raise InputError(
                    f"{self.source} lacks {missing[0]}, which shots.jsonl lists: upload the session again."
                )
            for name in sorted(names):
                path, sha256 = store.inside(session, name), hashes.get(name)
                if not path.exists() or (sha256 is not None and store.sha256(path) != sha256):
                    _copy(system, f"{root}/{name}", path, sha256, f"{self.source}/{name}")

    def store(self, session: Path, rows: Iterable[BatchRow], shots_sha256: str) -> None:
        """Store the session's records and results, without its photographs, and last the manifest.

        Args:
            session: folder here.
            rows: scenes that are made, with paths from that folder; rows of other scenes that were made of
                the same shots remain.
            shots_sha256: of the session's shots.jsonl in storage before it was fetched.

        Raises:
            InputError: the storage cannot be written.
        """
        before = self.manifest()
        paths = [path for path in session.iterdir() if path.name != MANIFEST]
        paths += [path for name in RESULTS for path in (session / name).rglob("*")]
        names = sorted(path.relative_to(session).as_posix() for path in paths if path.is_file())
        # What begins with a dot was left by a killed write.
        files = {name: store.sha256(session / name) for name in names if "/." not in f"/{name}"}
        with _speaking(self.target):
            system, root = _opened(self.target)
            new = [name for name, sha256 in files.items() if before.files.get(name) != sha256]
            if before.files.keys() & new:
                # Until the new one is there, no manifest may name files that are being replaced.
                system.rm_file(f"{root}/{MANIFEST}")
            for name in new:
                system.put_file(str(session / name), f"{root}/{name}")
            made = {row.scene: row for row in before.rows if before.shots_sha256 == shots_sha256}
            made |= {row.scene: row.model_copy(update={"session": Path(session.name)}) for row in rows}
            manifest = Manifest(
                source=self.source, shots_sha256=shots_sha256, files=files, rows=tuple(made.values())
            )
            system.pipe_file(f"{root}/{MANIFEST}", manifest.model_dump_json(indent=1).encode())


def is_url(text: str) -> bool:
    """Return whether a text names object storage, such as `s3://bucket/scans`."""
    return "://" in text


def sessions_at(pattern: str) -> Sequence[str]:
    """URLs of the sessions that a URL or a pattern such as `s3://bucket/scans/*` names, sorted.

    Raises:
        InputError: the storage cannot be read.
    """
    with _speaking(pattern):
        system, root = _opened(pattern)
        records = sorted(system.glob(f"{root}/{SESSION}"))
        return [str(system.unstrip_protocol(path.removesuffix(f"/{SESSION}"))) for path in records]


def _opened(url: str) -> tuple[Any, str]:
    """File system of a URL, and the path in it."""
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        raise InputError(f"{url} needs fsspec: pip install -e '.[cloud]'.") from None
    try:
        # Buckets have no folders to make; a mounted disk has.
        system, root = url_to_fs(url, **({"auto_mkdir": True} if url.startswith("file:") else {}))
    except ImportError as error:
        fix = "pip install -e '.[cloud]'" if url.startswith("s3:") else "install it with pip"
        raise InputError(f"{url} needs a package that is not installed ({_first(error)}): {fix}.") from None
    except ValueError as error:
        raise InputError(f"{url} is not storage that fsspec knows ({_first(error)}): correct it.") from None
    return system, str(root).rstrip("/")


@contextmanager
def _speaking(url: str) -> Iterator[None]:
    """Turn any error of a storage, each of which has its own kinds, into an InputError of one sentence."""
    try:
        yield
    except RigError:
        raise
    except Exception as error:
        raise _refused(url, error) from error


def _refused(url: str, error: Exception) -> InputError:
    return InputError(
        f"{url} cannot be used ({_first(error)}): check its name, your credentials and the network."
    )


def _first(error: Exception) -> str:
    """First line of an error, or its kind where it says nothing."""
    return next(iter(str(error).strip().splitlines()), type(error).__name__).rstrip(".")


def _copy(
    system: Any, path: str, to: Path, sha256: str | None, url: str, fix: str = "upload it again"
) -> None:
    """Copy one file here, whole or not at all; InputError where its hash is not as recorded."""
    with store.replacing(to) as part:
        try:
            system.get_file(path, str(part))
        except Exception as error:
            if isinstance(error, OSError) and error.errno == errno.ENOSPC:
                raise  # of the disk here
            raise _refused(url, error) from error
        if sha256 is not None and store.sha256(part) != sha256:
            raise InputError(f"{url} differs from its recorded SHA-256: {fix}.")


def _hashes(session: Path) -> dict[str, str | None]:
    """SHA-256 that the session records of each file of its shots; None of masks without one."""
    hashes: dict[str, str | None] = {}
    for shot in Session.open(session).shots():
        some: list[tuple[str | None, str | None]] = [(shot.file, shot.sha256)]
        some += [(shot.developed, shot.developed_sha256)]
        some += [(shot.mask, shot.mask_sha256), (shot.depth, shot.depth_sha256)]
        some += zip(shot.shifted, shot.shifted_sha256, strict=True)
        hashes |= {name: sha256 for name, sha256 in some if name is not None}
    return hashes
