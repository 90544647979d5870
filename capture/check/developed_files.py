"""Photographs that cameras made beside their RAW files: absent, or not those that were recorded."""

from collections.abc import Iterator, Sequence

from capture.check.findings import Problem, ProblemKind
from imaging.errors import InputError
from imaging.files import store
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def developed_problems(session: Session, shots: Sequence[ShotRecord]) -> Iterator[Problem]:
    """A problem for each photograph beside a RAW file that is not what its record says."""
    for shot in shots:
        if shot.developed is None:
            continue
        name = f"{shot.developed}, which the camera made beside {shot.file},"
        kind: ProblemKind = "absent"
        try:
            path = store.inside(session.folder, shot.developed)
        except InputError:
            kind, message = "index", f"shots.jsonl names {shot.developed!r}, which leads out of the session."
        else:
            if not path.is_file():
                message = f"{name} is not there: restore it from a copy."
            elif store.sha256(path) != shot.developed_sha256:
                kind = "altered"
                message = (
                    f"{name} is not the file that was recorded (its SHA-256 differs): restore it from a copy."
                )
            else:
                continue
        yield Problem(
            kind=kind,
            file=shot.developed,
            camera=shot.camera,
            frame=shot.frame,
            step=shot.step,
            message=message,
        )
