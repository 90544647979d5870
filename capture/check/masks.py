"""Masks of a session that are absent, damaged or not those that were recorded."""

from collections.abc import Iterator, Sequence

from capture.check.findings import Problem, ProblemKind
from imaging.errors import InputError
from imaging.files import store
from imaging.merge.masks import read_mask
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def mask_problems(session: Session, shots: Sequence[ShotRecord], again: str) -> Iterator[Problem]:
    """Masks that are absent, damaged or not those that were recorded; again: how to get them anew."""
    for shot in shots:
        if shot.mask is None:
            continue
        name = f"{shot.mask}, the mask of {shot.file},"
        try:
            path = session.mask(shot)
            assert path is not None
            if not path.is_file():
                kind: ProblemKind = "absent"
                message = f"{name} is not there: restore it from a copy, or {again}."
            elif shot.mask_sha256 is None:
                read_mask(path, shot.height, shot.width)
                continue
            elif store.sha256(path) != shot.mask_sha256:
                kind = "altered"
                message = (
                    f"{name} is not the file that was recorded (its SHA-256 differs): restore it from a "
                    f"copy, or {again}."
                )
            else:
                continue
        except InputError as error:
            kind, message = "torn", str(error)
        yield Problem(
            kind=kind, file=shot.mask, camera=shot.camera, frame=shot.frame, step=shot.step, message=message
        )
