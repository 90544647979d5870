"""The order of file names in which people number them."""

import re
from pathlib import PurePath


def natural(path: PurePath) -> list[tuple[str | int, ...]]:
    """A key that sorts IMG_9 before IMG_10, folder by folder."""
    return [
        tuple(int(piece) if piece.isdecimal() else piece for piece in re.split(r"(\d+)", part.casefold()))
        for part in path.parts
    ]
