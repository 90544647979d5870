"""Frames that another render of a path left: programs read them as parts of the same shot."""

import re
from collections.abc import Collection
from pathlib import Path

_FILE = re.compile(r"-?\d+(?:\.(?:exr|png|jpg|avif)|_[+-][\d.e+-]+ev\.png|_\d+\.dng)")
"""Names of the files that `render` writes of a frame, behind the name of the path and a dot."""


def earlier_frames(out: Path, name: str, written: Collection[Path]) -> list[str]:
    """Name the files of frames of a path of that name in a folder, but for those just written."""
    new = {path.name for path in written}
    return sorted(
        path.name
        for path in out.iterdir()
        if path.name.startswith(f"{name}.")
        and path.name not in new
        and _FILE.fullmatch(path.name.removeprefix(f"{name}."))
    )
