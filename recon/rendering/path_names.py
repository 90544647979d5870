"""Names of camera paths, known before a scene is loaded."""

import os
from os import PathLike

from imaging.errors import InputError

FRAMES = 120
MOST_FRAMES = 100_000


def named_frames(text: str) -> tuple[str, int] | None:
    """Parse `orbit`, `orbit:N`, `spline` or `spline:N` of N frames; None for any other. InputError for a bad
    N.
    """
    name, colon, count = text.partition(":")
    if name not in ("orbit", "spline"):
        return None
    if not colon:
        return name, FRAMES
    if not count.isdecimal() or not 1 <= int(count) <= MOST_FRAMES:
        raise InputError(f"{text!r} is not a path: write {name}:N, N frames from 1 to {MOST_FRAMES}.")
    return name, int(count)


def check_path(path: str | PathLike[str]) -> None:
    """InputError if a path is neither a name nor there."""
    if named_frames(str(path)) is None and not os.path.exists(path):
        raise InputError(
            f"{path} is not a path to render: write orbit:N, spline:N, or name transforms.json, a folder "
            "with a COLMAP model, a CSV table or a USD file."
        )
