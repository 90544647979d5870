"""The sharpest frames of a video, as photographs: what a telephone filmed can be imported."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2

from capture.imports.originals import shown
from capture.imports.video.video_colours import refuse_other_displays
from imaging.arrays import Bytes
from imaging.compute.memory import check_picture
from imaging.errors import InputError
from imaging.files import store
from imaging.files.photo import encode_png
from imaging.files.silence import quiet
from imaging.progress import Progress

SUFFIXES = frozenset((".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi"))

MOST = 200
"""Frames that are taken of one video."""
APART = 0.5
"""Seconds between two of them at least, on average."""


def is_video(path: Path) -> bool:
    """Return whether a path is a file with the suffix of a video."""
    return path.suffix.lower() in SUFFIXES and path.is_file()


def take_frames(video: Path, into: Path, progress: Progress) -> str:
    """Write the sharpest frame of each part of a video as PNG, and say in a sentence what was taken.

    InputError where the file is no video, is coded for displays of HDR, or takes more memory than there is.
    """
    refuse_other_displays(video)
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
        f"{taken} frames of {shown(video.name)} are taken, {every}. Video is compressed, its exposure "
        "changes all the time, and its shutter rolls: photographs taken at rest are better."
    )


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
