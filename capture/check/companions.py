"""Files beside those that are read, absent, damaged or altered: masks, depth maps, the camera's own files."""

from collections.abc import Callable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path

from capture.check.findings import Problem, ProblemKind
from imaging.errors import InputError
from imaging.files import store
from imaging.files.depth import read_depth, require_shape
from imaging.merge.masks import read_mask
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def companion_problems(session: Session, shots: Sequence[ShotRecord], again: str) -> Iterator[Problem]:
    """Yield what is wrong with masks and depth maps; again: how to get them anew."""
    for shot in shots:
        yield from _problems(session.mask, shot, shot.mask, shot.mask_sha256, "mask", again)
        yield from _problems(session.depth, shot, shot.depth, shot.depth_sha256, "depth map", again)


def _problems(
    path_of: Callable[[ShotRecord], Path | None],
    shot: ShotRecord,
    file: str | None,
    sha256: str | None,
    what: str,
    again: str,
) -> Iterator[Problem]:
    if file is None:
        return
    name = f"{file}, the {what} of {shot.file},"
    try:
        path = path_of(shot)
        assert path is not None
        if not path.is_file():
            kind: ProblemKind = "absent"
            message = f"{name} is missing: restore it from a copy, or {again}."
        elif sha256 is None:
            _require_readable(path, shot, what)
            return
        elif store.sha256(path) != sha256:
            kind = "altered"
            message = (
                f"{name} is not the file that was recorded (its SHA-256 differs): restore it from a "
                f"copy, or {again}."
            )
        else:
            return
    except InputError as error:
        kind, message = "torn", str(error)
    yield Problem(kind=kind, file=file, camera=shot.camera, frame=shot.frame, step=shot.step, message=message)


def _require_readable(path: Path, shot: ShotRecord, what: str) -> None:
    if what == "mask":
        read_mask(path, shot.height, shot.width)
    else:
        require_shape(path, read_depth(path)[0], shot.height, shot.width)


def developed_problems(session: Session, shots: Sequence[ShotRecord]) -> Iterator[Problem]:
    """A problem for each file beside that of a shot that is not what its record says."""
    beside = [
        (shot, file, digest, f"{file}, {what} {shot.file},")
        for shot in shots
        for file, digest, what in (
            (shot.developed, shot.developed_sha256, "which the camera made beside"),
            *(
                (original, stated, "which belongs to what was made into")
                for original, stated in _made_of(shot)
            ),
        )
        if file is not None
    ]
    for shot, file, digest, name in beside:
        kind: ProblemKind = "absent"
        try:
            path = store.inside(session.folder, file)
        except InputError:
            kind, message = "index", f"shots.jsonl names {file!r}, which leads out of the session."
        else:
            if not path.is_file():
                message = f"{name} is missing: restore it from a copy."
            else:
                try:
                    if store.sha256(path) == digest:
                        continue
                    kind = "altered"
                    message = (
                        f"{name} is not the file that was recorded (its SHA-256 differs): restore it from a "
                        "copy."
                    )
                except InputError as error:
                    kind, message = "torn", str(error)
        yield Problem(
            kind=kind,
            file=file,
            camera=shot.camera,
            frame=shot.frame,
            step=shot.step,
            message=message,
        )


def _made_of(shot: ShotRecord) -> Iterator[tuple[str, str | None]]:
    """Name and hash of each file that it was made of; the hash is None if the record has too few."""
    return zip_longest(shot.shifted, shot.shifted_sha256[: len(shot.shifted)])
