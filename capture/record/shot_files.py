"""Name and place of a shot's file."""

import hashlib
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from capture.bracket.single_exposure import CapturedFrame
from capture.record.threads.exposure_step import ExposureStep, SavedShot
from drivers.errors import CameraProtocol
from imaging.choices import Compression
from imaging.errors import InputError
from imaging.files import photo, raw, store
from imaging.files.tiff.dng import dng_pieces
from imaging.sensor.mosaic import RawMosaic
from imaging.session.session import Session
from imaging.session.view_id import ViewId


class ShotId(NamedTuple):
    """A shot of a plan: which camera, at which frame, at which step of the bracket."""

    camera: str
    frame: int
    step: int

    def __str__(self) -> str:
        return f"{self.camera}, frame {self.frame}, step {self.step}"

    @property
    def view(self) -> ViewId:
        """The view that it is a shot of."""
        return ViewId(self.frame, self.camera)


def shot_file(shot_id: ShotId, suffix: str) -> str:
    """Return where the file of a shot stands, relative to the session folder."""
    return f"raw/{shot_id.view}_{shot_id.step}.{suffix}"


def save_frame(
    session: Session, compression: Compression, step: ExposureStep, camera: str, captured: CapturedFrame
) -> SavedShot:
    """The file of a shot. The hash is of the bytes that were meant, so that `check` proves the disk."""
    frame = captured.frame
    pieces: list[bytes | memoryview]
    if isinstance(frame, RawMosaic):
        pieces, suffix = dng_pieces(frame, compression), "dng"
        height, width = frame.pixels.shape
    else:
        pieces, suffix = [frame.data], frame.suffix.lstrip(".").lower()
        height, width = frame.height, frame.width
    file = shot_file(ShotId(camera, step.frame, step.number), suffix)
    digest = hashlib.sha256()
    for piece in pieces:
        digest.update(piece)
    developed = None if isinstance(frame, RawMosaic) else frame.developed
    # First: a shot without its own file is taken again.
    beside, beside_sha256 = save_developed(session, ShotId(camera, step.frame, step.number), developed)
    store.write_pieces(session.folder / file, pieces)
    return SavedShot(
        file=file,
        sha256=digest.hexdigest(),
        developed=beside,
        developed_sha256=beside_sha256,
        reported=captured.reported,
        width=width,
        height=height,
        captured_at=frame.metadata.captured_at or datetime.now(UTC),
        ordered=captured.ordered,
        opened=frame.metadata.opened,
        opened_by=captured.opened_by,
        unknown=frame.metadata.unknown,
        retries=captured.retries,
        host=None if isinstance(frame, RawMosaic) else frame.host,
    )


def must_decode(session: Session, saved: SavedShot) -> None:
    """Read a camera's own file back from the disk; CameraProtocol if its pixels are damaged.

    It is then removed with what lies beside it: the shot is to be taken again.
    """
    path = session.folder / saved.file
    try:
        if raw.is_raw(path):
            raw.read_raw(path)
        else:
            photo.decode_codes(path.read_bytes(), saved.file)
    except InputError as error:
        for file in _files(session, saved):
            store.discard(file)
        raise CameraProtocol(f"the camera delivered a damaged file: {error}") from error


def set_aside(session: Session, saved: SavedShot) -> None:
    """Rename the files of a doubtful shot, so that another attempt overwrites none of them.

    Their names are those of leftovers, which the next run removes should this one be killed.
    """
    for path in _files(session, saved):
        store.rename(path, _aside(path))


def put_back(session: Session, saved: SavedShot) -> None:
    """Undo `set_aside`, in place of what further attempts left."""
    for path in _files(session, saved):
        if _aside(path).exists():
            store.rename(_aside(path), path)


def drop_aside(session: Session, saved: SavedShot) -> None:
    """Remove the files of a doubtful shot: another attempt gave a better one."""
    for path in _files(session, saved):
        store.discard(_aside(path))


def _files(session: Session, saved: SavedShot) -> list[Path]:
    return [session.folder / file for file in (saved.file, saved.developed) if file is not None]


def _aside(path: Path) -> Path:
    return path.with_name(f".{path.name}.doubtful.part")


def save_developed(
    session: Session, shot_id: ShotId, developed: tuple[str, bytes] | None
) -> tuple[str | None, str | None]:
    """Write the photograph beside a RAW file, its suffix and bytes; its name and hash, if there is one."""
    if developed is None:
        return None, None
    suffix, data = developed
    file = shot_file(shot_id, suffix.lstrip(".").lower())
    store.write_bytes(session.folder / file, data)
    return file, hashlib.sha256(data).hexdigest()


def shifted_file(shot_id: ShotId, number: int, suffix: str) -> str:
    """Return where a file that a shot was made of lies, relative to the session; counted from 1."""
    return f"shifted/{shot_id.view}_{shot_id.step}_{number}{suffix}"


def depth_file(shot_id: ShotId, suffix: str) -> str:
    """Return where the depth map of a shot lies, relative to the session."""
    return f"depths/{shot_id.view}_{shot_id.step}{suffix}"


def mask_file(shot_id: ShotId, suffix: str) -> str:
    """Return where the mask of a shot lies, relative to the session."""
    return f"masks/{shot_id.view}_{shot_id.step}{suffix}"
