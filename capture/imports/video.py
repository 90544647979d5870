"""The sharpest frames of a video, as photographs: what a telephone filmed can be imported."""

import math
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2

from capture.imports.originals import shown
from imaging.arrays import Bytes
from imaging.compute.memory import check_picture
from imaging.errors import InputError
from imaging.files import store
from imaging.files.cicp import UNSPECIFIED, name_of, refuse_hdr
from imaging.files.photo import encode_png
from imaging.files.silence import quiet
from imaging.progress import Progress

SUFFIXES = frozenset((".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi"))

MOST = 200
"""Frames that are taken of one video."""
APART = 0.5
"""Seconds between two of them at least, on average."""

_NARROW = (1, UNSPECIFIED, 5, 6, 7)
"""ColourPrimaries whose colours are those of sRGB, or nearly."""
_BOX = re.compile(rb"colrncl[cx](..)(..)", re.DOTALL)
_EBML, _CLUSTER = b"\x1a\x45\xdf\xa3", b"\x1f\x43\xb6\x75"
_ELEMENT = re.compile(rb"\x55\xb0(.{1,250})", re.DOTALL)
_PRIMARIES, _TRANSFER = rb"\x55\xbb", rb"\x55\xba"
_LARGEST = 1 << 26
"""Bytes of a file's tables that are looked through."""


def is_video(path: Path) -> bool:
    """Return whether a path is a file with the suffix of a video."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def take_frames(video: Path, into: Path, progress: Progress) -> str:
    """Write the sharpest frame of each part of a video as PNG, and say in a sentence what was taken.

    InputError where the file is no video, is coded for displays of HDR, or takes more memory than there is.
    """
    primaries, transfer = _colour(video)
    try:
        refuse_hdr(transfer, "colour information")
        if primaries not in _NARROW:
            raise InputError(f"has {name_of(primaries)} as the primaries of its colours")
    except InputError as error:
        raise InputError(
            f"{video} {str(error).partition(':')[0]}: export it as SDR (Rec. 709) first."
        ) from None
    into.mkdir(parents=True, exist_ok=True)
    taken = 0
    with quiet():
        capture = cv2.VideoCapture(str(video))
    try:
        width, height = (
            int(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        if capture.isOpened():
            check_picture(str(video), width, height)
        rate = capture.get(cv2.CAP_PROP_FPS)
        rate = rate if 1 <= rate <= 1000 else 30.0
        whole = max(1, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        part = max(1, round(rate * APART), math.ceil(whole / MOST))
        for taken, frame in enumerate(_sharpest(_frames(capture), part), start=1):
            progress("reading the video", min(taken * part, whole), whole)
            store.write_bytes(into / f"{video.stem}_{taken:04d}.png", encode_png(frame[..., ::-1]))
    finally:
        capture.release()
    if not taken:
        raise InputError(f"{video} cannot be read as a video: copy it again, or convert it.")
    progress("read the video", whole, whole)
    every = f"the sharpest of every {part} ({part / rate:.2g} s)"
    return (
        f"{taken} frames of {shown(video.name)} are taken, {every}. A video is compressed, exposed anew by "
        "the camera all the time and read row by row while it moves: photographs taken standing still are "
        "better."
    )


def _colour(video: Path) -> tuple[int, int]:
    """ColourPrimaries and TransferCharacteristics (ITU-T H.273) of a file; 2: unspecified, or not found.

    In the box `colr` of MP4 and MOV (ISO/IEC 14496-12), and in the element `Colour` of Matroska and WebM
    (RFC 9559, 5.1.4.1.28.16).
    """
    with video.open("rb") as file:
        if file.read(4) == _EBML:
            file.seek(0)
            head = file.read(_LARGEST).partition(_CLUSTER)[0]
            match = _ELEMENT.search(head)
            parts = b"" if match is None else match[1]
            said = (re.search(name + rb"\x81(.)", parts, re.DOTALL) for name in (_PRIMARIES, _TRANSFER))
            primaries, transfer = (UNSPECIFIED if one is None else one[1][0] for one in said)
            return primaries, transfer
        file.seek(0)
        while len(head := file.read(8)) == 8:
            start, length = file.tell() - 8, int.from_bytes(head[:4])
            if head[4:] == b"moov":
                box = _BOX.search(file.read(min(length, _LARGEST)))
                return (UNSPECIFIED,) * 2 if box is None else (int.from_bytes(box[1]), int.from_bytes(box[2]))
            if length == 1:
                length = int.from_bytes(file.read(8))
            if length < 8:
                break
            file.seek(start + length)
    return UNSPECIFIED, UNSPECIFIED


def _frames(capture: Any) -> Iterator[Bytes]:
    while True:
        there, frame = capture.read()
        if not there:
            return
        yield frame


def _sharpest(frames: Iterable[Bytes], part: int) -> Iterator[Bytes]:
    """Sharpest of every `part` frames, uint8 [H, W, 3]: the most contrast between neighbouring pixels."""
    best, most, number = None, -1.0, 0
    for number, frame in enumerate(frames, start=1):
        sharp = float(cv2.Laplacian(frame[..., 1], cv2.CV_32F).var())
        if sharp > most:
            best, most = frame, sharp
        if number % part == 0 and best is not None:
            yield best
            best, most = None, -1.0
    # What is over at the end is a part of its own only where there is no other.
    if best is not None and number < part:
        yield best
