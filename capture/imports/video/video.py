"""The sharpest frames of a video, as photographs: what a telephone filmed can be imported."""

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
_ROUNDING = 1e-3
"""Seconds to which containers round the times of frames."""
_MOST_STATED = 1e8
"""Frames from which on, as below 1, a stated number is no count: files written live have no length."""


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
        whole, seconds = _length(video, capture, rate, progress)
        period = max(APART, 1 / rate, seconds / MOST)
        for taken, (done, frame) in enumerate(_sharpest(_frames(capture, rate), period), start=1):
            progress("reading the video", min(done, whole), whole)
            store.write_bytes(into / f"{video.stem}_{taken:04d}.png", encode_png(frame[..., ::-1]))
    finally:
        capture.release()
    if not taken:
        raise InputError(f"{video} cannot be read as a video: copy it again, or convert it.")
    progress("read the video", whole, whole)
    return (
        f"{taken} frames of {shown(video.name)} are taken, the sharpest of every {period:.2g} s. Video is "
        "compressed, its exposure changes all the time, and its shutter rolls: photographs taken at rest are "
        "better."
    )


def _length(video: Path, capture: Any, rate: float, progress: Progress) -> tuple[int, float]:
    """Frames of a video, and its seconds; by going through it where it does not state how many they are."""
    stated = capture.get(cv2.CAP_PROP_FRAME_COUNT)
    if 1 <= stated < _MOST_STATED:
        return int(stated), stated / rate
    progress("measuring the video", 0, 1)
    with quiet():
        other = cv2.VideoCapture(str(video))
    try:
        times = list(_times(other, rate))
    finally:
        other.release()
    progress("measuring the video", 1, 1)
    return max(1, len(times)), max(times, default=0.0) + 1 / rate


def _times(capture: Any, rate: float) -> Iterator[float]:
    """Seconds from the first frame to each, which is then grabbed.

    Where the times in the file do not rise they are counted on by the rate.
    """
    start, time = None, -1 / rate
    while capture.grab():
        stated = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        start = stated if start is None else start
        time = stated - start if stated - start > time else time + 1 / rate
        yield time


def _frames(capture: Any, rate: float) -> Iterator[tuple[float, Bytes]]:
    for time in _times(capture, rate):
        there, frame = capture.retrieve()
        if not there:
            return
        yield time, frame


def _sharpest(frames: Iterable[tuple[float, Bytes]], period: float) -> Iterator[tuple[int, Bytes]]:
    """Sharpest frame of every `period` seconds, uint8 [H, W, 3], and how many are read by then.

    Sharp is what has the most contrast between neighbouring pixels.
    """
    best, most, part, last, step, number = None, -1.0, 0, 0.0, 0.0, 0
    for number, (time, frame) in enumerate(frames, start=1):
        now = int((time + _ROUNDING) / period)
        if now != part and best is not None:
            yield number, best
            best, most = None, -1.0
        part, last, step = now, time, time - last
        sharp = float(cv2.Laplacian(frame[..., 1], cv2.CV_32F).var())
        if sharp > most:
            best, most = frame, sharp
    # What is over at the end is a part of its own where it is as long as one, or there is no other.
    if best is not None and (part == 0 or last + step + _ROUNDING >= (part + 1) * period):
        yield number, best
