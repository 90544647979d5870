"""Masks: pictures that say which pixels of a photograph are to be ignored."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from imaging.arrays import Mask
from imaging.errors import InputError
from imaging.files.photo import decode_codes
from imaging.merge.linear_frame import LinearFrame
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def mask_of(session: Session, shot: ShotRecord, height: int, width: int) -> Mask | None:
    """Read the mask of a shot, if it has one.

    Args:
        session: Session.
        shot: Shot.
        height: Height of the shot, px.
        width: Width of the shot, px.

    Returns:
        The pixels that count, bool [height, width], as `read_mask` has it; None where the shot has no mask,
        and all count.

    Raises:
        InputError: The mask is missing, is not a JPEG, PNG or TIFF, is damaged or of another size.
    """
    path = session.mask(shot)
    return None if path is None else read_mask(path, height, width)


def masked(session: Session, shots: Sequence[ShotRecord], frames: Sequence[LinearFrame]) -> list[LinearFrame]:
    """The frames of shots, in their order, with nothing valid behind their masks; errors as `read_mask`."""
    return [
        without(frame, mask_of(session, shot, *frame.signal.shape[:2]))
        for shot, frame in zip(shots, frames, strict=True)
    ]


def without(frame: LinearFrame, counts: Mask | None) -> LinearFrame:
    """The frame, invalid where pixels are excluded; counts: bool [H, W], None: all count."""
    if counts is None:
        return frame
    return replace(frame, valid=frame.valid & (counts if frame.valid.ndim == 2 else counts[..., None]))


def read_mask(path: Path, height: int, width: int) -> Mask:
    """Read the mask of pixels that count, bool [height, width]: neither black, as COLMAP and nerfstudio have
    it, nor fully transparent.

    InputError when the file is missing, is not a JPEG, PNG or TIFF, is damaged or of another size.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"The mask {path} cannot be read ({(error.strerror or 'error').lower()}): "
            "restore it, or import again without masks."
        ) from error
    codes = decode_codes(data, f"The mask {path}", "make it again as a PNG, black where to ignore")
    if codes.shape[:2] != (height, width):
        raise InputError(
            f"The mask {path} has {codes.shape[1]}x{codes.shape[0]} pixels and its photograph "
            f"{width}x{height}: make it of the same size."
        )
    lit = codes[..., : 1 if codes.shape[2] < 3 else 3].any(-1)
    return np.asarray(lit & (codes[..., -1] > 0) if codes.shape[2] in (2, 4) else lit)
