"""Where the file of a shot stands, and how it gets there."""

import hashlib
from datetime import UTC, datetime
from typing import NamedTuple

from capture.bracket.single_exposure import Taken
from capture.record.exposure_step import Round, Written
from imaging.files import store
from imaging.files.dng import Compression, dng_pieces
from imaging.mosaic import RawMosaic
from imaging.session.session import Session


class Slot(NamedTuple):
    """A shot of a plan: which camera, at which frame, at which step of the bracket."""

    camera: str
    frame: int
    step: int

    def __str__(self) -> str:
        return f"{self.camera}, frame {self.frame}, step {self.step}"


def shot_file(slot: Slot, suffix: str) -> str:
    """Where the file of a shot stands, relative to the session folder."""
    return f"raw/{slot.frame:04d}/{slot.camera}_{slot.step}.{suffix}"


def save_frame(session: Session, compression: Compression, one: Round, camera: str, taken: Taken) -> Written:
    """The file of a shot. The hash is of the bytes that were meant, so that `check` proves the disk."""
    frame = taken.frame
    pieces: list[bytes | memoryview]
    if isinstance(frame, RawMosaic):
        pieces, suffix = dng_pieces(frame, compression), "dng"
        height, width = frame.pixels.shape
    else:
        pieces, suffix = [frame.data], frame.suffix.lstrip(".").lower()
        height, width = frame.height, frame.width
    file = shot_file(Slot(camera, one.frame, one.step), suffix)
    digest = hashlib.sha256()
    for piece in pieces:
        digest.update(piece)
    store.write_pieces(session.folder / file, pieces)
    return Written(
        file=file,
        sha256=digest.hexdigest(),
        reported=taken.reported,
        width=width,
        height=height,
        captured_at=frame.metadata.captured_at or datetime.now(UTC),
        opened=taken.opened,
        retries=taken.retries,
    )


def mask_file(slot: Slot, suffix: str) -> str:
    """Where the mask of a shot lies, relative to the session."""
    return f"masks/{slot.frame:04d}/{slot.camera}_{slot.step}{suffix}"
