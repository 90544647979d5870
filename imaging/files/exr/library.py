"""EXR files as the OpenEXR library opens them: headers and pixels of their parts, or one error."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from imaging.arrays import AnyArray
from imaging.errors import InputError
from imaging.files.silence import quiet

_MAGIC = b"\x76\x2f\x31\x01"


def headers(path: Path) -> list[dict[str, Any]]:
    """The header of every part."""
    with _opened(path, header_only=True) as exr:
        return [dict(part.header) for part in exr.parts]


def parts(path: Path) -> list[tuple[dict[str, Any], dict[str, AnyArray]]]:
    """Header and pixels of every part, copied out before the library empties them."""
    with _opened(path, header_only=False) as exr:
        return [
            (dict(part.header), {name: np.array(channel.pixels) for name, channel in part.channels.items()})
            for part in exr.parts
        ]


@contextmanager
def _opened(path: Path, header_only: bool) -> Iterator[Any]:
    """The library's file, of one part or more; InputError for whatever it complains of in the block."""
    if not path.is_file():
        raise InputError(f"{path} is not a file: name an EXR file.")
    try:
        with path.open("rb") as file:
            if file.read(4) != _MAGIC:
                raise InputError(f"{path} is not an EXR file: choose one that is.")
        with quiet(), OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as exr:
            if not exr.parts:  # the library only prints why
                raise damaged(path)
            yield exr
    except (RuntimeError, ValueError, TypeError, OSError, MemoryError) as error:
        raise damaged(path) from error


def deep(path: Path) -> InputError:
    """Error for a file whose pixels rig does not read."""
    return InputError(f"{path} is deep or subsampled, which rig does not read: export it flat, as RGB.")


def damaged(path: Path) -> InputError:
    """Error for a file that is cut off, or makes no sense."""
    return InputError(f"{path} is damaged or cut off: write or copy it again.")
