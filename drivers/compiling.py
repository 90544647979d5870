"""Numba's compiler as a typed decorator, and loops shared among threads.

Compiled code runs without Python's lock, so plain threads use all cores. Numba's own parallel loops go
through OpenMP, which must not be forked after use and stalls when other programs want the cores too.

It is kept for the next start of the program in `$NUMBA_CACHE_DIR`, else `$XDG_CACHE_HOME/hdr-rig/numba`,
else `~/.cache/hdr-rig/numba`, in a folder named by a hash of the sources: Numba itself notices a change
of the file that holds a function, not of a file whose functions it inlined.
"""

import hashlib
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar, cast

import numba

FunctionT = TypeVar("FunctionT", bound=Callable[..., object])


def _cache_folder() -> Path | None:
    """Where compiled code is kept, made if need be; None where nothing can be written."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    folder = (Path(given) if given else home / "hdr-rig" / "numba") / digest.hexdigest()[:16]
    nearest = next(parent for parent in (folder, *folder.parents) if parent.exists())
    return folder if os.access(nearest, os.W_OK | os.X_OK) else None


_FOLDER = _cache_folder()


def compiled(function: FunctionT) -> FunctionT:
    """Compile a function of numbers and arrays at its first call."""
    before = numba.config.CACHE_DIR
    try:
        if _FOLDER is not None:
            numba.config.CACHE_DIR = str(_FOLDER)
        return cast(FunctionT, numba.njit(cache=_FOLDER is not None, nogil=True)(function))
    finally:
        # The setting is global; other packages of the program choose for themselves.
        numba.config.CACHE_DIR = before


def share(count: int, stride: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, last)` on pieces of `stride` that cover 0..count, on all cores of this process."""
    pieces = [(first, min(first + stride, count)) for first in range(0, count, stride)]
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with ThreadPoolExecutor(max_workers=min(cores, max(len(pieces), 1))) as pool:
        for _ in pool.map(lambda piece: work(*piece), pieces):
            pass
