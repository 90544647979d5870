"""Masks and depth maps of a session that are absent, damaged or not those that were recorded."""

from collections.abc import Callable, Iterator, Sequence
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
            message = f"{name} is not there: restore it from a copy, or {again}."
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
