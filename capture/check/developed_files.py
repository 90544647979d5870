"""Files kept beside those that are read, by the camera or as what they were made of: absent, or altered."""

from collections.abc import Iterator, Sequence
from itertools import zip_longest

from capture.check.findings import Problem, ProblemKind
from imaging.errors import InputError
from imaging.files import store
from imaging.session.records import ShotRecord
from imaging.session.session import Session


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
                message = f"{name} is not there: restore it from a copy."
            elif store.sha256(path) != digest:
                kind = "altered"
                message = (
                    f"{name} is not the file that was recorded (its SHA-256 differs): restore it from a copy."
                )
            else:
                continue
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
